/* FMI 3.0 for model exchange around the equations in model.c: continuous states and no events.
   Modelica Association, Functional Mock-up Interface Specification 3.0, https://fmi-standard.org */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "model.c"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void *fmi3Instance;
typedef void *fmi3FMUState;
typedef uint32_t Reference;
typedef void (*LogMessage)(void *environment, fmi3Status status, const char *category, const char *message);

/* value references: 0 is the time, then states, their derivatives, parameters, inputs, outputs */
enum {
  TIME = 0,
  STATES = 1,
  RATES = STATES + model_n_x,
  PARAMETERS = RATES + model_n_x,
  INPUTS = PARAMETERS + model_n_p,
  OUTPUTS = INPUTS + model_n_u,
  END = OUTPUTS + model_n_y
};

typedef struct {
  double t, x[model_n_x + 1], dx[model_n_x + 1], z[model_n_z + 1], p[model_n_p + 1], u[model_n_u + 1], y[model_n_y + 1];
  bool fresh; /* whether dx, z and y belong to the rest */
} Values;

typedef struct {
  Values now;
  LogMessage log;
  void *environment;
} Model;

static fmi3Status fail(Model *model, fmi3Status status, const char *message) {
  if (model->log) model->log(model->environment, status, status == fmi3Discard ? "logStatusDiscard" : "logStatusError", message);
  return status;
}

static void begin(Values *now) {
  memset(now, 0, sizeof *now);
  memcpy(now->x, model_x_start, sizeof(double) * model_n_x);
  memcpy(now->z, model_z_start, sizeof(double) * model_n_z);
  memcpy(now->p, model_p_start, sizeof(double) * model_n_p);
  memcpy(now->u, model_u_start, sizeof(double) * model_n_u);
}

static fmi3Status evaluate(Model *model) {
  Values *now = &model->now;
  int k;
  if (now->fresh) return fmi3OK;
  if (model_evaluate(now->t, now->x, now->z, now->p, now->u, now->dx, now->y)) {
    memcpy(now->z, model_z_start, sizeof(double) * model_n_z); /* try from the first guess, once */
    if (model_evaluate(now->t, now->x, now->z, now->p, now->u, now->dx, now->y))
      return fail(model, fmi3Discard, "the algebraic equations have no solution here");
  }
  for (k = 0; k < model_n_x; ++k)
    if (!isfinite(now->dx[k])) return fail(model, fmi3Discard, "a derivative is not finite");
  now->fresh = true;
  return fmi3OK;
}

/* -- instances ---------------------------------------------------------------------------------------------------- */
EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Instance fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
                                                 bool logging, void *environment, LogMessage log) {
  Model *model;
  (void)name, (void)resources, (void)visible, (void)logging;
  if (!token || strcmp(token, model_token)) {
    if (log) log(environment, fmi3Error, "logStatusError", "modelDescription.xml and the binary do not belong together");
    return NULL;
  }
  model = calloc(1, sizeof *model);
  if (!model) return NULL;
  model->log = log;
  model->environment = environment;
  begin(&model->now);
  return model;
}

EXPORT void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

EXPORT fmi3Status fmi3Reset(fmi3Instance instance) {
  begin(&((Model *)instance)->now);
  return fmi3OK;
}

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance instance, bool on, size_t n, const char *const categories[]) {
  (void)instance, (void)on, (void)n, (void)categories;
  return fmi3OK;
}

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, bool has_tolerance, double tolerance, double start,
                                              bool has_stop, double stop) {
  (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
  ((Model *)instance)->now.t = start;
  ((Model *)instance)->now.fresh = false;
  return fmi3OK;
}

/* changes of mode that change no value */
#define NOTHING(name) \
  EXPORT fmi3Status name(fmi3Instance instance) { \
    (void)instance; \
    return fmi3OK; \
  }
NOTHING(fmi3ExitInitializationMode)
NOTHING(fmi3EnterEventMode)
NOTHING(fmi3EnterContinuousTimeMode)
NOTHING(fmi3EvaluateDiscreteStates)
NOTHING(fmi3Terminate)

/* -- values ------------------------------------------------------------------------------------------------------- */
EXPORT fmi3Status fmi3GetFloat64(fmi3Instance instance, const Reference references[], size_t n, double values[],
                                 size_t n_values) {
  Model *model = instance;
  Values *now = &model->now;
  size_t k;
  if (n != n_values) return fail(model, fmi3Error, "every variable is one number");
  for (k = 0; k < n; ++k) {
    int i = (int)references[k];
    if (references[k] >= END) return fail(model, fmi3Error, "there is no variable with this value reference");
    if ((i >= RATES && i < PARAMETERS) || i >= OUTPUTS) {
      fmi3Status status = evaluate(model);
      if (status != fmi3OK) return status;
    }
    values[k] = i == TIME ? now->t : i < RATES ? now->x[i - STATES] : i < PARAMETERS ? now->dx[i - RATES]
              : i < INPUTS ? now->p[i - PARAMETERS] : i < OUTPUTS ? now->u[i - INPUTS] : now->y[i - OUTPUTS];
  }
  return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance instance, const Reference references[], size_t n, const double values[],
                                 size_t n_values) {
  Model *model = instance;
  Values *now = &model->now;
  size_t k;
  if (n != n_values) return fail(model, fmi3Error, "every variable is one number");
  for (k = 0; k < n; ++k) {
    int i = (int)references[k];
    if (references[k] >= OUTPUTS || i == TIME || (i >= RATES && i < PARAMETERS))
      return fail(model, fmi3Error, "only states, parameters and inputs can be set");
    *(i < RATES ? &now->x[i - STATES] : i < INPUTS ? &now->p[i - PARAMETERS] : &now->u[i - INPUTS]) = values[k];
  }
  now->fresh = false;
  return fmi3OK;
}

/* -- states ------------------------------------------------------------------------------------------------------- */
EXPORT fmi3Status fmi3SetTime(fmi3Instance instance, double time) {
  Values *now = &((Model *)instance)->now;
  now->fresh = now->fresh && time == now->t;
  now->t = time;
  return fmi3OK;
}

EXPORT fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const double x[], size_t n) {
  Values *now = &((Model *)instance)->now;
  if (n != model_n_x) return fail(instance, fmi3Error, "the number of states is another");
  memcpy(now->x, x, sizeof(double) * n);
  now->fresh = false;
  return fmi3OK;
}

EXPORT fmi3Status fmi3GetContinuousStates(fmi3Instance instance, double x[], size_t n) {
  if (n != model_n_x) return fail(instance, fmi3Error, "the number of states is another");
  memcpy(x, ((Model *)instance)->now.x, sizeof(double) * n);
  return fmi3OK;
}

EXPORT fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, double dx[], size_t n) {
  fmi3Status status;
  if (n != model_n_x) return fail(instance, fmi3Error, "the number of states is another");
  status = evaluate(instance);
  if (status == fmi3OK) memcpy(dx, ((Model *)instance)->now.dx, sizeof(double) * n);
  return status;
}

EXPORT fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, double nominals[], size_t n) {
  if (n != model_n_x) return fail(instance, fmi3Error, "the number of states is another");
  memcpy(nominals, model_x_nominal, sizeof(double) * n);
  return fmi3OK;
}

EXPORT fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n) {
  (void)instance;
  *n = model_n_x;
  return fmi3OK;
}

EXPORT fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, bool no_return, bool *event, bool *terminate) {
  (void)instance, (void)no_return;
  *event = *terminate = false;
  return fmi3OK;
}

/* -- derivatives ------------------------------------------------------------------------------------------------------ */
/* What the rates, the outputs and the residual of the algebraic equations change along a direction of everything else. */
static int slopes(const Values *now, const Values *along, double *dx, double *y, double *residual) {
  const double *arg[] = {&now->t, now->x, now->z, now->p, now->u, &along->t, along->x, along->z, along->p, along->u};
  double *res[] = {dx, y, residual};
  return model_directions(arg, res, 0, 0, 0);
}

/* As above, with the algebraic unknowns going along such that their equations hold: dg/dz z' = -(the rest of g'). */
static fmi3Status directions(Model *model, Values *along) {
  const Values *now = &model->now;
  double residual[model_n_z + 1], jacobian[model_n_z * model_n_z + 1];
  int k;
  if (model_n_z) {
    if (slopes(now, along, 0, 0, residual) || model_call(now->t, now->x, now->z, now->p, now->u, 0, 0, 0, jacobian) ||
        !model_solve(model_n_z, jacobian, residual))
      return fail(model, fmi3Discard, "the algebraic equations have no derivative here");
    for (k = 0; k < model_n_z; ++k) along->z[k] = -residual[k];
  }
  return slopes(now, along, along->dx, along->y, 0) ? fail(model, fmi3Discard, "there is no derivative here") : fmi3OK;
}

EXPORT fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const Reference unknowns[], size_t n_unknowns,
                                               const Reference knowns[], size_t n_knowns, const double seed[],
                                               size_t n_seed, double sensitivity[], size_t n_sensitivity) {
  Model *model = instance;
  Values along;
  fmi3Status status;
  size_t k;
  if (n_knowns != n_seed || n_unknowns != n_sensitivity) return fail(model, fmi3Error, "every variable is one number");
  memset(&along, 0, sizeof along);
  for (k = 0; k < n_knowns; ++k) {
    int i = (int)knowns[k];
    if (knowns[k] >= OUTPUTS || (i >= RATES && i < PARAMETERS))
      return fail(model, fmi3Error, "derivatives are taken by the time, states, parameters and inputs only");
    *(i == TIME ? &along.t : i < RATES ? &along.x[i - STATES] : i < INPUTS ? &along.p[i - PARAMETERS]
      : &along.u[i - INPUTS]) = seed[k];
  }
  status = evaluate(model);
  if (status == fmi3OK) status = directions(model, &along);
  for (k = 0; k < n_unknowns && status == fmi3OK; ++k) {
    int i = (int)unknowns[k];
    if (unknowns[k] >= END || i < RATES || (i >= PARAMETERS && i < OUTPUTS))
      return fail(model, fmi3Error, "derivatives are known of the states' derivatives and of the outputs only");
    sensitivity[k] = i < PARAMETERS ? along.dx[i - RATES] : along.y[i - OUTPUTS];
  }
  return status;
}

/* -- events: there are none ------------------------------------------------------------------------------------------ */
EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, bool *again, bool *terminate, bool *nominals_changed,
                                           bool *states_changed, bool *next_known, double *next) {
  (void)instance;
  *again = *terminate = *nominals_changed = *states_changed = *next_known = false;
  *next = 0;
  return fmi3OK;
}

EXPORT fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n) {
  (void)instance;
  *n = 0;
  return fmi3OK;
}

EXPORT fmi3Status fmi3GetEventIndicators(fmi3Instance instance, double indicators[], size_t n) {
  (void)indicators;
  return n ? fail(instance, fmi3Error, "there are no event indicators") : fmi3OK;
}

/* -- snapshots ------------------------------------------------------------------------------------------------------- */
EXPORT fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
  if (!*state) *state = malloc(sizeof(Values));
  if (!*state) return fail(instance, fmi3Error, "no memory is left");
  memcpy(*state, &((Model *)instance)->now, sizeof(Values));
  return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
  memcpy(&((Model *)instance)->now, state, sizeof(Values));
  return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) {
  (void)instance;
  free(*state);
  *state = NULL;
  return fmi3OK;
}

/* -- what is not here: all variables are real numbers, and there are no clocks --------------------------------------- */
#define NONE(name, type) \
  EXPORT fmi3Status fmi3Get##name(fmi3Instance instance, const Reference references[], size_t n, type values[], size_t m) { \
    (void)references, (void)values, (void)m; \
    return n ? fail(instance, fmi3Error, "there is no variable of this type") : fmi3OK; \
  } \
  EXPORT fmi3Status fmi3Set##name(fmi3Instance instance, const Reference references[], size_t n, const type values[], \
                                  size_t m) { \
    (void)references, (void)values, (void)m; \
    return n ? fail(instance, fmi3Error, "there is no variable of this type") : fmi3OK; \
  }
typedef const char *Text;
NONE(Float32, float)
NONE(Int8, int8_t)
NONE(UInt8, uint8_t)
NONE(Int16, int16_t)
NONE(UInt16, uint16_t)
NONE(Int32, int32_t)
NONE(UInt32, uint32_t)
NONE(Int64, int64_t)
NONE(UInt64, uint64_t)
NONE(Boolean, bool)
NONE(String, Text)

/* The further arguments are not looked at, so that these serve for every list of them. */
#define REFUSED(name) \
  EXPORT fmi3Status name(fmi3Instance instance) { return fail(instance, fmi3Error, #name " is not offered"); }
REFUSED(fmi3GetBinary)
REFUSED(fmi3SetBinary)
REFUSED(fmi3GetClock)
REFUSED(fmi3SetClock)
REFUSED(fmi3GetNumberOfVariableDependencies)
REFUSED(fmi3GetVariableDependencies)
REFUSED(fmi3SerializedFMUStateSize)
REFUSED(fmi3SerializeFMUState)
REFUSED(fmi3DeserializeFMUState)
REFUSED(fmi3GetAdjointDerivative)
REFUSED(fmi3EnterConfigurationMode)
REFUSED(fmi3ExitConfigurationMode)
REFUSED(fmi3GetIntervalDecimal)
REFUSED(fmi3GetIntervalFraction)
REFUSED(fmi3GetShiftDecimal)
REFUSED(fmi3GetShiftFraction)
REFUSED(fmi3SetIntervalDecimal)
REFUSED(fmi3SetIntervalFraction)
REFUSED(fmi3SetShiftDecimal)
REFUSED(fmi3SetShiftFraction)
REFUSED(fmi3EnterStepMode)
REFUSED(fmi3GetOutputDerivatives)
REFUSED(fmi3DoStep)
REFUSED(fmi3ActivateModelPartition)

EXPORT fmi3Instance fmi3InstantiateCoSimulation(void) { return NULL; }
EXPORT fmi3Instance fmi3InstantiateScheduledExecution(void) { return NULL; }
