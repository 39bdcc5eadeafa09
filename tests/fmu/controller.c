/* A sampled controller as an FMU for co-simulation, for the tests: force = gain * position, one step late, `count` its steps.
   With FMI3 defined it speaks FMI 3.0, else FMI 2.0. Only what an importer of such an FMU calls does anything.
   With a gain of 0 it asks for the end of the simulation in its 11th step.
   References: 0 position, 1 gain, 2 force, 3 count (integer), 4 engaged (boolean); with FMI3 also 5 weights[3], 6 scales[2],
   and 7 table[2, 3], the products of scales and weights. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

typedef struct {
  double real[3];
  double weights[3], scales[2], table[6];
  int32_t count;
  int engaged;
} Controller;

static int step(Controller *c, double h) {
  if (!(h > 0) || c->real[0] > 1e3) return 3;
  if (c->real[1] == 0 && c->count == 10) return 2;
  c->real[2] = c->engaged ? c->real[1] * c->real[0] : 0;
  for (int k = 0; k < 6; ++k) c->table[k] = c->scales[k / 3] * c->weights[k % 3];
  c->count += 1;
  return 0;
}

static Controller *make(void) {
  Controller *c = calloc(1, sizeof *c);
  c->real[1] = -10;
  c->engaged = 1;
  return c;
}

#ifdef FMI3
#define N , size_t m
typedef bool Truth;
typedef void (*Log)(void *, int, const char *, const char *);
static Log listener;
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging,
                                  bool events, bool early, const uint32_t *intermediate, size_t n, void *environment, Log log,
                                  void *update) {
  listener = log;
  return make();
}
int fmi3EnterInitializationMode(void *c, bool has_tolerance, double tolerance, double start, bool has_stop, double stop) { return 0; }
int fmi3DoStep(void *c, double t, double h, bool no_set, bool *event, bool *terminate, bool *early, double *last) {
  int status = step(c, h);
  *event = *early = false;
  *terminate = status == 2;
  *last = t + h;
  if (status == 2) return 0;
  if (status) listener(NULL, status, "logStatusError", "the position is out of reach");
  return status;
}
#define F(name) fmi3##name
#else
#define N
typedef int Truth;
typedef struct { void (*logger)(void *, const char *, int, const char *, const char *, ...); } Callbacks;
static const Callbacks *callbacks;
void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const Callbacks *given, int visible,
                      int logging) {
  callbacks = given;
  return make();
}
int fmi2SetupExperiment(void *c, int has_tolerance, double tolerance, double start, int has_stop, double stop) { return 0; }
int fmi2EnterInitializationMode(void *c) { return 0; }
int fmi2DoStep(void *c, double t, double h, int no_set) {
  int status = step(c, h);
  if (status == 3) callbacks->logger(NULL, "controller", status, "logStatusError", "the position is out of reach");
  return status;
}
int fmi2GetBooleanStatus(void *c, int kind, int *value) {
  *value = kind == 3;
  return 0;
}
#define F(name) fmi2##name
#endif

int F(ExitInitializationMode)(void *c) { return 0; }
int F(Terminate)(void *c) { return 0; }
void F(FreeInstance)(void *c) { free(c); }
#define ACCESS(set, get, type, place) \
  int set(void *instance, const uint32_t *r, size_t n, const type *v N) { \
    Controller *c = instance; \
    for (size_t k = 0; k < n; ++k) place = v[k]; \
    return 0; \
  } \
  int get(void *instance, const uint32_t *r, size_t n, type *v N) { \
    Controller *c = instance; \
    for (size_t k = 0; k < n; ++k) v[k] = place; \
    return 0; \
  }
#ifdef FMI3
static size_t place(Controller *c, uint32_t reference, double **begin) {
  *begin = reference < 3 ? &c->real[reference] : reference == 5 ? c->weights : reference == 6 ? c->scales : c->table;
  return reference < 3 ? 1 : reference == 5 ? 3 : reference == 6 ? 2 : 6;
}
int fmi3SetFloat64(void *c, const uint32_t *r, size_t n, const double *v, size_t m) {
  double *begin;
  for (size_t k = 0; k < n; ++k)
    for (size_t i = 0, size = place(c, r[k], &begin); i < size; ++i)
      if (m-- > 0) begin[i] = *v++; else return 3;
  return m ? 3 : 0;
}
int fmi3GetFloat64(void *c, const uint32_t *r, size_t n, double *v, size_t m) {
  double *begin;
  for (size_t k = 0; k < n; ++k)
    for (size_t i = 0, size = place(c, r[k], &begin); i < size; ++i)
      if (m-- > 0) *v++ = begin[i]; else return 3;
  return m ? 3 : 0;
}
ACCESS(fmi3SetInt32, fmi3GetInt32, int32_t, c->count)
ACCESS(fmi3SetBoolean, fmi3GetBoolean, Truth, c->engaged)
#else
ACCESS(fmi2SetReal, fmi2GetReal, double, c->real[r[k]])
ACCESS(fmi2SetInteger, fmi2GetInteger, int32_t, c->count)
ACCESS(fmi2SetBoolean, fmi2GetBoolean, Truth, c->engaged)
#endif

/* what importers look for, but do not call here */
#define NONE(name) int F(name)(void *c) { return 3; }
#ifdef FMI3
NONE(ActivateModelPartition) NONE(CompletedIntegratorStep) NONE(DeserializeFMUState) NONE(EnterConfigurationMode)
NONE(EnterContinuousTimeMode) NONE(EnterEventMode) NONE(EnterStepMode) NONE(EvaluateDiscreteStates)
NONE(ExitConfigurationMode) NONE(FreeFMUState) NONE(GetAdjointDerivative) NONE(GetBinary) NONE(GetClock)
NONE(GetContinuousStateDerivatives) NONE(GetContinuousStates) NONE(GetDirectionalDerivative) NONE(GetEventIndicators)
NONE(GetFMUState) NONE(GetFloat32) NONE(GetInt16) NONE(GetInt64) NONE(GetInt8) NONE(GetIntervalDecimal)
NONE(GetIntervalFraction) NONE(GetNominalsOfContinuousStates) NONE(GetNumberOfContinuousStates)
NONE(GetNumberOfEventIndicators) NONE(GetNumberOfVariableDependencies) NONE(GetOutputDerivatives)
NONE(GetShiftDecimal) NONE(GetShiftFraction) NONE(GetString) NONE(GetUInt16) NONE(GetUInt32) NONE(GetUInt64)
NONE(GetUInt8) NONE(GetVariableDependencies) NONE(GetVersion) NONE(InstantiateModelExchange)
NONE(InstantiateScheduledExecution) NONE(Reset) NONE(SerializeFMUState) NONE(SerializedFMUStateSize) NONE(SetBinary)
NONE(SetClock) NONE(SetContinuousStates) NONE(SetDebugLogging) NONE(SetFMUState) NONE(SetFloat32) NONE(SetInt16)
NONE(SetInt64) NONE(SetInt8) NONE(SetIntervalDecimal) NONE(SetIntervalFraction) NONE(SetShiftDecimal)
NONE(SetShiftFraction) NONE(SetString) NONE(SetTime) NONE(SetUInt16) NONE(SetUInt32) NONE(SetUInt64) NONE(SetUInt8)
NONE(UpdateDiscreteStates)
#else
NONE(CancelStep) NONE(DeSerializeFMUstate) NONE(FreeFMUstate) NONE(GetDirectionalDerivative)
NONE(GetFMUstate) NONE(GetIntegerStatus) NONE(GetRealOutputDerivatives) NONE(GetRealStatus) NONE(GetStatus)
NONE(GetString) NONE(GetStringStatus) NONE(GetTypesPlatform) NONE(GetVersion) NONE(Reset) NONE(SerializeFMUstate)
NONE(SerializedFMUstateSize) NONE(SetDebugLogging) NONE(SetFMUstate) NONE(SetRealInputDerivatives) NONE(SetString)
#endif
