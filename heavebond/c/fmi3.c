/* FMI 3.0 for model exchange and co-simulation around the equations in model.c.
   Modelica Association, Functional Mock-up Interface Specification 3.0, https://fmi-standard.org */
#include "fmu_core.c"

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void *fmi3Instance;
typedef void *fmi3FMUState;
typedef void (*LogMessage)(void *environment, fmi3Status status, const char *category, const char *message);

typedef struct {
  Values now;
  LogMessage log;
  void *environment;
  bool event_mode, early_return; /* the importing program lets events happen, and takes steps that end at them */
} Model;

static fmi3Status fail(Model *model, fmi3Status status, const char *message) {
  if (model->log) model->log(model->environment, status, status == fmi3Discard ? "logStatusDiscard" : "logStatusError", message);
  return status;
}

/* The status for what is wrong: values for which there is no solution can be given up, wrong calls are errors. */
static fmi3Status judge(Model *model, const char *wrong) {
  if (!wrong) return fmi3OK;
  return fail(model, can_be_given_up(wrong) ? fmi3Discard : fmi3Error, wrong);
}

/* -- instances ---------------------------------------------------------------------------------------------------- */
EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

static fmi3Instance instantiate(const char *token, void *environment, LogMessage log) {
  Model *model;
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

EXPORT fmi3Instance fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
                                                 bool logging, void *environment, LogMessage log) {
  Model *model = model_n_d ? NULL : instantiate(token, environment, log);
  (void)name, (void)resources, (void)visible, (void)logging;
  if (model_n_d && log) log(environment, fmi3Error, "logStatusError", NO_EXCHANGE);
  if (model) model->event_mode = true;
  return model;
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                                bool logging, bool event_mode, bool early_return,
                                                const Reference intermediate[], size_t n_intermediate, void *environment,
                                                LogMessage log, void *intermediate_update) {
  Model *model = instantiate(token, environment, log);
  (void)name, (void)resources, (void)visible, (void)logging;
  (void)intermediate, (void)n_intermediate, (void)intermediate_update;
  if (model) model->event_mode = event_mode, model->early_return = event_mode && early_return;
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
  Values *now = &((Model *)instance)->now;
  if (has_stop && stop > start) now->events.span = stop - start;
  if (has_tolerance && tolerance > 0) now->tolerance = tolerance;
  begin_at(now, start);
  return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
  Model *model = instance;
  bool changed; /* in event mode, what happens at the start is left to fmi3UpdateDiscreteStates */
  const char *wrong = end_start(&model->now);
  if (wrong) return judge(model, wrong);
  return model->event_mode ? fmi3OK : judge(model, update(&model->now, &changed));
}

/* changes of mode that change no value */
#define NOTHING(name) \
  EXPORT fmi3Status name(fmi3Instance instance) { \
    (void)instance; \
    return fmi3OK; \
  }
NOTHING(fmi3EnterEventMode)
NOTHING(fmi3EnterContinuousTimeMode)
NOTHING(fmi3EnterStepMode)
NOTHING(fmi3EvaluateDiscreteStates)
NOTHING(fmi3Terminate)

/* -- values ------------------------------------------------------------------------------------------------------- */
EXPORT fmi3Status fmi3GetFloat64(fmi3Instance instance, const Reference references[], size_t n, double values[],
                                 size_t n_values) {
  Model *model = instance;
  if (n != n_values) return fail(model, fmi3Error, "every variable is one number");
  return judge(model, get_values(&model->now, references, n, values));
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance instance, const Reference references[], size_t n, const double values[],
                                 size_t n_values) {
  Model *model = instance;
  if (n != n_values) return fail(model, fmi3Error, "every variable is one number");
  return judge(model, set_values(&model->now, references, n, values));
}

/* -- states ------------------------------------------------------------------------------------------------------- */
EXPORT fmi3Status fmi3SetTime(fmi3Instance instance, double time) {
  Values *now = &((Model *)instance)->now;
  set_time(now, time);
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
  const char *wrong = solve_start(&((Model *)instance)->now);
  memcpy(x, ((Model *)instance)->now.x, sizeof(double) * n);
  return judge(instance, wrong);
}

EXPORT fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, double dx[], size_t n) {
  fmi3Status status;
  if (n != model_n_x) return fail(instance, fmi3Error, "the number of states is another");
  status = judge(instance, evaluate(&((Model *)instance)->now));
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
  const char *wrong = limit_passed(&((Model *)instance)->now);
  (void)no_return;
  *event = false;
  *terminate = wrong != NULL;
  return judge(instance, wrong);
}

/* -- derivatives ------------------------------------------------------------------------------------------------------ */
EXPORT fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const Reference unknowns[], size_t n_unknowns,
                                               const Reference knowns[], size_t n_knowns, const double seed[],
                                               size_t n_seed, double sensitivity[], size_t n_sensitivity) {
  Model *model = instance;
  if (n_knowns != n_seed || n_unknowns != n_sensitivity) return fail(model, fmi3Error, "every variable is one number");
  return judge(model, derivative(&model->now, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity));
}

/* -- steps of co-simulation ------------------------------------------------------------------------------------------- */
EXPORT fmi3Status fmi3DoStep(fmi3Instance instance, double point, double step, bool no_return, bool *event, bool *terminate,
                             bool *early, double *reached) {
  Model *model = instance;
  fmi3Status status;
  double end = point + step - model->now.origin;
  (void)no_return;
  *event = *terminate = *early = false;
  *reached = absolute_time(&model->now);
  if (!(step >= 0)) return fail(model, fmi3Error, "a step is not negative");
  begin_step(&model->now, point);
  status = judge(model, do_step(&model->now, end, model->early_return, event));
  *early = *event && model->now.t < end;
  *reached = model->now.t < end ? absolute_time(&model->now) : point + step;
  return status;
}

/* -- events ---------------------------------------------------------------------------------------------------------- */
EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, bool *again, bool *terminate, bool *nominals_changed,
                                           bool *states_changed, bool *next_known, double *next) {
  Values *now = &((Model *)instance)->now;
  fmi3Status status;
  *again = *terminate = *nominals_changed = *next_known = false;
  *next = 0;
  status = judge(instance, update(now, states_changed));
  if (status != fmi3OK || !model_n_e) return status;
  *next = now->origin + next_instant(now);
  if (!(*next_known = *next < INFINITY)) *next = 0;
  return status;
}

EXPORT fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n) {
  (void)instance;
  *n = model_n_c;
  return fmi3OK;
}

EXPORT fmi3Status fmi3GetEventIndicators(fmi3Instance instance, double indicators[], size_t n) {
  if (n != model_n_c) return fail(instance, fmi3Error, "the number of event indicators is another");
  return n ? judge(instance, indicate(&((Model *)instance)->now, indicators)) : fmi3OK;
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

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size) {
  (void)instance, (void)state;
  *size = sizeof(Values);
  return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, uint8_t bytes[], size_t size) {
  if (size < sizeof(Values)) return fail(instance, fmi3Error, "the block is too short for a state");
  memcpy(bytes, state, sizeof(Values));
  return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const uint8_t bytes[], size_t size, fmi3FMUState *state) {
  if (size != sizeof(Values)) return fail(instance, fmi3Error, "the block is no state of this FMU");
  if (!*state) *state = malloc(sizeof(Values));
  if (!*state) return fail(instance, fmi3Error, "no memory is left");
  memcpy(*state, bytes, sizeof(Values));
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
REFUSED(fmi3GetOutputDerivatives)
REFUSED(fmi3ActivateModelPartition)

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(void) { return NULL; }
