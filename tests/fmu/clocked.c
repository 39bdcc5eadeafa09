/* An integrator that a clock samples, as an FMU of FMI 3.0 for co-simulation with event mode and for model exchange, for the tests.
   References: 1 u, 2 x with x' = u, 4 y = x while the clock is active and otherwise no number, 5 n ticks (integer), 10 and 12 input
   clocks, 11 an output clock that is active at every second tick, 6 z = x while it is active. The interval after n ticks, if it
   is calculated, is 0.2 + 0.1 n. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

typedef struct {
  double t, u, x;
  int32_t n;
  bool active, events;
} Clocked;

static void *make(bool events) {
  Clocked *c = calloc(1, sizeof *c);
  c->events = events;
  return c;
}
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging,
                                  bool events, bool early, const uint32_t *intermediate, size_t n, void *environment, void *log,
                                  void *update) {
  return make(events);
}
void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible, bool logging,
                                   void *environment, void *log) {
  return make(true);
}
int fmi3EnterInitializationMode(void *c, bool has_tolerance, double tolerance, double start, bool has_stop, double stop) {
  ((Clocked *)c)->t = start;
  return 0;
}
int fmi3DoStep(void *instance, double t, double h, bool no_set, bool *event, bool *terminate, bool *early, double *last) {
  Clocked *c = instance;
  if (fabs(t - c->t) > 1e-9) return 3;
  c->x += c->u * h;
  *last = c->t = t + h;
  *event = *terminate = *early = false;
  return 0;
}
int fmi3SetFloat64(void *c, const uint32_t *r, size_t n, const double *v, size_t m) {
  if (n != 1 || m != 1 || *r != 1) return 3;
  ((Clocked *)c)->u = *v;
  return 0;
}
int fmi3GetFloat64(void *instance, const uint32_t *r, size_t n, double *v, size_t m) {
  Clocked *c = instance;
  if (n != 1 || m != 1) return 3;
  *v = *r == 1 ? c->u : *r == 2 ? c->x : *r == 3 ? c->u : c->active && (*r != 6 || c->n % 2 == 0) ? c->x : c->n ? NAN : 0;
  return 0;
}
int fmi3GetInt32(void *c, const uint32_t *r, size_t n, int32_t *v, size_t m) {
  *v = ((Clocked *)c)->n;
  return 0;
}
int fmi3SetClock(void *c, const uint32_t *r, size_t n, const bool *v) {
  if (n != 1 || (*r != 10 && *r != 12)) return 3;
  ((Clocked *)c)->active = *v;
  return 0;
}
int fmi3GetClock(void *instance, const uint32_t *r, size_t n, bool *v) {
  Clocked *c = instance;
  if (n != 1 || *r != 11) return 3;
  *v = c->active && c->n % 2 == 0;
  return 0;
}
int fmi3GetIntervalDecimal(void *c, const uint32_t *r, size_t n, double *interval, int *qualifier) {
  if (n != 1 || *r != 10) return 3;
  *interval = 0.2 + 0.1 * ((Clocked *)c)->n;
  *qualifier = 2;
  return 0;
}
int fmi3UpdateDiscreteStates(void *instance, bool *again, bool *ends, bool *nominals, bool *states, bool *defined, double *next) {
  Clocked *c = instance;
  if (!c->events) return 3;
  c->n += c->active;
  *again = *ends = *nominals = *states = *defined = c->active = false;
  return 0;
}
int fmi3SetTime(void *c, double t) { ((Clocked *)c)->t = t; return 0; }
int fmi3GetNumberOfContinuousStates(void *c, size_t *n) { *n = 1; return 0; }
int fmi3GetNumberOfEventIndicators(void *c, size_t *n) { *n = 0; return 0; }
int fmi3SetContinuousStates(void *c, const double *x, size_t n) { ((Clocked *)c)->x = *x; return 0; }
int fmi3GetContinuousStates(void *c, double *x, size_t n) { *x = ((Clocked *)c)->x; return 0; }
int fmi3GetContinuousStateDerivatives(void *c, double *dx, size_t n) { *dx = ((Clocked *)c)->u; return 0; }
int fmi3GetNominalsOfContinuousStates(void *c, double *x, size_t n) { *x = 1; return 0; }
int fmi3CompletedIntegratorStep(void *c, bool no_set, bool *event, bool *terminate) {
  *event = *terminate = false;
  return 0;
}
int fmi3ExitInitializationMode(void *c) { return 0; }
int fmi3EnterEventMode(void *c) { return ((Clocked *)c)->events ? 0 : 3; }
int fmi3EnterStepMode(void *c) { return 0; }
int fmi3EnterContinuousTimeMode(void *c) { return 0; }
int fmi3Terminate(void *c) { return 0; }
void fmi3FreeInstance(void *c) { free(c); }

/* what importers look for, but do not call here */
#define NONE(name) int fmi3##name(void *c) { return 3; }
NONE(ActivateModelPartition) NONE(DeserializeFMUState) NONE(EnterConfigurationMode) NONE(EvaluateDiscreteStates)
NONE(ExitConfigurationMode) NONE(FreeFMUState) NONE(GetAdjointDerivative) NONE(GetBinary) NONE(GetBoolean)
NONE(GetDirectionalDerivative) NONE(GetEventIndicators) NONE(GetFMUState) NONE(GetFloat32) NONE(GetInt16) NONE(GetInt64)
NONE(GetInt8) NONE(GetIntervalFraction) NONE(GetNumberOfVariableDependencies)
NONE(GetOutputDerivatives) NONE(GetShiftDecimal) NONE(GetShiftFraction) NONE(GetString) NONE(GetUInt16) NONE(GetUInt32)
NONE(GetUInt64) NONE(GetUInt8) NONE(GetVariableDependencies) NONE(GetVersion) NONE(InstantiateScheduledExecution)
NONE(Reset) NONE(SerializeFMUState) NONE(SerializedFMUStateSize) NONE(SetBinary) NONE(SetBoolean) NONE(SetDebugLogging)
NONE(SetFMUState) NONE(SetFloat32) NONE(SetInt16) NONE(SetInt32) NONE(SetInt64) NONE(SetInt8) NONE(SetIntervalDecimal)
NONE(SetIntervalFraction) NONE(SetShiftDecimal) NONE(SetShiftFraction) NONE(SetString) NONE(SetUInt16) NONE(SetUInt32)
NONE(SetUInt64) NONE(SetUInt8)
