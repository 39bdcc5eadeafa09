/* FMI 2.0 for model exchange and co-simulation around the equations in model.c.
   Modelica Association, Functional Mock-up Interface Specification 2.0, https://fmi-standard.org */
#include "fmu_core.c"

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef void *fmi2Component;
typedef void *fmi2FMUstate;
typedef int fmi2Boolean;
typedef struct {
  void (*log)(void *environment, const char *instance, fmi2Status status, const char *category, const char *message, ...);
  void *(*allocate)(size_t n, size_t size);
  void (*release)(void *block);
  void (*finished)(void *environment, fmi2Status status);
  void *environment;
} Callbacks;

typedef struct {
  fmi2Boolean again, terminate, nominals_changed, states_changed, next_known;
  double next;
} EventInfo;

typedef struct {
  Values now;
  Callbacks calls;
  char name[256];
  bool model_exchange;
} Model;

static fmi2Status fail(Model *model, fmi2Status status, const char *message) {
  if (model->calls.log)
    model->calls.log(model->calls.environment, model->name, status,
                     status == fmi2Discard ? "logStatusDiscard" : "logStatusError", "%s", message);
  return status;
}

/* The status for what is wrong: values for which there is no solution can be given up, wrong calls are errors. */
static fmi2Status judge(Model *model, const char *wrong) {
  if (!wrong) return fmi2OK;
  return fail(model, can_be_given_up(wrong) ? fmi2Discard : fmi2Error, wrong);
}

/* -- instances ---------------------------------------------------------------------------------------------------- */
EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Component fmi2Instantiate(const char *name, int type, const char *token, const char *resources,
                                     const Callbacks *calls, fmi2Boolean visible, fmi2Boolean logging) {
  Model *model;
  (void)resources, (void)visible, (void)logging;
  if (!token || strcmp(token, model_token)) {
    if (calls && calls->log)
      calls->log(calls->environment, name, fmi2Error, "logStatusError", "%s",
                 "modelDescription.xml and the binary do not belong together");
    return NULL;
  }
  if (type == 0 && model_n_d) {
    if (calls && calls->log) calls->log(calls->environment, name, fmi2Error, "logStatusError", "%s", NO_EXCHANGE);
    return NULL;
  }
  model = calloc(1, sizeof *model);
  if (!model) return NULL;
  if (calls) model->calls = *calls;
  model->model_exchange = type == 0;
  strncpy(model->name, name ? name : "", sizeof model->name - 1);
  begin(&model->now);
  return model;
}

EXPORT void fmi2FreeInstance(fmi2Component instance) { free(instance); }

EXPORT fmi2Status fmi2Reset(fmi2Component instance) {
  begin(&((Model *)instance)->now);
  return fmi2OK;
}

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component instance, fmi2Boolean on, size_t n, const char *const categories[]) {
  (void)instance, (void)on, (void)n, (void)categories;
  return fmi2OK;
}

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component instance, fmi2Boolean has_tolerance, double tolerance, double start,
                                      fmi2Boolean has_stop, double stop) {
  Values *now = &((Model *)instance)->now;
  if (has_stop && stop > start) now->events.span = stop - start;
  if (has_tolerance && tolerance > 0) now->tolerance = tolerance;
  begin_at(now, start);
  return fmi2OK;
}

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component instance) {
  Model *model = instance;
  bool changed; /* in model exchange, what happens at the start is left to fmi2NewDiscreteStates */
  const char *wrong = end_start(&model->now);
  if (wrong) return judge(model, wrong);
  return model->model_exchange ? fmi2OK : judge(model, update(&model->now, &changed));
}

/* changes of mode that change no value */
#define NOTHING(name) \
  EXPORT fmi2Status name(fmi2Component instance) { \
    (void)instance; \
    return fmi2OK; \
  }
NOTHING(fmi2EnterInitializationMode)
NOTHING(fmi2EnterEventMode)
NOTHING(fmi2EnterContinuousTimeMode)
NOTHING(fmi2Terminate)

/* -- values and steps ------------------------------------------------------------------------------------------------- */
EXPORT fmi2Status fmi2GetReal(fmi2Component instance, const Reference references[], size_t n, double values[]) {
  return judge(instance, get_values(&((Model *)instance)->now, references, n, values));
}

EXPORT fmi2Status fmi2SetReal(fmi2Component instance, const Reference references[], size_t n, const double values[]) {
  return judge(instance, set_values(&((Model *)instance)->now, references, n, values));
}

EXPORT fmi2Status fmi2DoStep(fmi2Component instance, double point, double step, fmi2Boolean no_return) {
  Model *model = instance;
  bool event;
  (void)no_return;
  if (!(step >= 0)) return fail(model, fmi2Error, "a step is not negative");
  begin_step(&model->now, point);
  return judge(model, do_step(&model->now, point + step - model->now.origin, false, &event));
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component instance) { return fail(instance, fmi2Error, "no step is pending"); }

EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component instance, const Reference unknowns[], size_t n_unknowns,
                                               const Reference knowns[], size_t n_knowns, const double seed[],
                                               double sensitivity[]) {
  return judge(instance, derivative(&((Model *)instance)->now, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity));
}

/* -- model exchange --------------------------------------------------------------------------------------------------- */
EXPORT fmi2Status fmi2SetTime(fmi2Component instance, double time) {
  Values *now = &((Model *)instance)->now;
  set_time(now, time);
  return fmi2OK;
}

EXPORT fmi2Status fmi2SetContinuousStates(fmi2Component instance, const double x[], size_t n) {
  Values *now = &((Model *)instance)->now;
  if (n != model_n_x) return fail(instance, fmi2Error, "the number of states is another");
  memcpy(now->x, x, sizeof(double) * n);
  now->fresh = false;
  return fmi2OK;
}

EXPORT fmi2Status fmi2GetContinuousStates(fmi2Component instance, double x[], size_t n) {
  if (n != model_n_x) return fail(instance, fmi2Error, "the number of states is another");
  const char *wrong = solve_start(&((Model *)instance)->now);
  memcpy(x, ((Model *)instance)->now.x, sizeof(double) * n);
  return judge(instance, wrong);
}

EXPORT fmi2Status fmi2GetDerivatives(fmi2Component instance, double dx[], size_t n) {
  fmi2Status status;
  if (n != model_n_x) return fail(instance, fmi2Error, "the number of states is another");
  status = judge(instance, evaluate(&((Model *)instance)->now));
  if (status == fmi2OK) memcpy(dx, ((Model *)instance)->now.dx, sizeof(double) * n);
  return status;
}

EXPORT fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component instance, double nominals[], size_t n) {
  if (n != model_n_x) return fail(instance, fmi2Error, "the number of states is another");
  memcpy(nominals, model_x_nominal, sizeof(double) * n);
  return fmi2OK;
}

EXPORT fmi2Status fmi2GetEventIndicators(fmi2Component instance, double indicators[], size_t n) {
  if (n != model_n_c) return fail(instance, fmi2Error, "the number of event indicators is another");
  return n ? judge(instance, indicate(&((Model *)instance)->now, indicators)) : fmi2OK;
}

EXPORT fmi2Status fmi2CompletedIntegratorStep(fmi2Component instance, fmi2Boolean no_return, fmi2Boolean *event,
                                              fmi2Boolean *terminate) {
  const char *wrong = limit_passed(&((Model *)instance)->now);
  (void)no_return;
  *event = 0;
  *terminate = wrong != NULL;
  return judge(instance, wrong);
}

EXPORT fmi2Status fmi2NewDiscreteStates(fmi2Component instance, EventInfo *info) {
  Values *now = &((Model *)instance)->now;
  bool states_changed;
  fmi2Status status;
  memset(info, 0, sizeof *info);
  status = judge(instance, update(now, &states_changed));
  if (status != fmi2OK) return status;
  info->states_changed = states_changed;
  info->next = model_n_e ? now->origin + next_instant(now) : INFINITY;
  if (!(info->next_known = info->next < INFINITY)) info->next = 0;
  return status;
}

/* -- snapshots ------------------------------------------------------------------------------------------------------- */
EXPORT fmi2Status fmi2GetFMUstate(fmi2Component instance, fmi2FMUstate *state) {
  if (!*state) *state = malloc(sizeof(Values));
  if (!*state) return fail(instance, fmi2Error, "no memory is left");
  memcpy(*state, &((Model *)instance)->now, sizeof(Values));
  return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component instance, fmi2FMUstate state) {
  memcpy(&((Model *)instance)->now, state, sizeof(Values));
  return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component instance, fmi2FMUstate *state) {
  (void)instance;
  free(*state);
  *state = NULL;
  return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component instance, fmi2FMUstate state, size_t *size) {
  (void)instance, (void)state;
  *size = sizeof(Values);
  return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component instance, fmi2FMUstate state, char bytes[], size_t size) {
  if (size < sizeof(Values)) return fail(instance, fmi2Error, "the block is too short for a state");
  memcpy(bytes, state, sizeof(Values));
  return fmi2OK;
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component instance, const char bytes[], size_t size, fmi2FMUstate *state) {
  if (size != sizeof(Values)) return fail(instance, fmi2Error, "the block is no state of this FMU");
  if (!*state) *state = malloc(sizeof(Values));
  if (!*state) return fail(instance, fmi2Error, "no memory is left");
  memcpy(*state, bytes, sizeof(Values));
  return fmi2OK;
}

/* -- what is not here: all variables are real numbers ------------------------------------------------------------------ */
#define NONE(name, type) \
  EXPORT fmi2Status fmi2Get##name(fmi2Component instance, const Reference references[], size_t n, type values[]) { \
    (void)references, (void)values; \
    return n ? fail(instance, fmi2Error, "there is no variable of this type") : fmi2OK; \
  } \
  EXPORT fmi2Status fmi2Set##name(fmi2Component instance, const Reference references[], size_t n, const type values[]) { \
    (void)references, (void)values; \
    return n ? fail(instance, fmi2Error, "there is no variable of this type") : fmi2OK; \
  }
typedef const char *Text;
NONE(Integer, int)
NONE(Boolean, fmi2Boolean)
NONE(String, Text)

/* The further arguments are not looked at, so that these serve for every list of them. */
#define REFUSED(name) \
  EXPORT fmi2Status name(fmi2Component instance) { return fail(instance, fmi2Error, #name " is not offered"); }
REFUSED(fmi2SetRealInputDerivatives)
REFUSED(fmi2GetRealOutputDerivatives)

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component instance, int kind, double *value) {
  if (kind != 2) return fmi2Discard;
  *value = absolute_time(&((Model *)instance)->now); /* the last successful time */
  return fmi2OK;
}

/* steps are never pending */
#define STATUS(name, type) \
  EXPORT fmi2Status name(fmi2Component instance, int kind, type *value) { \
    (void)instance, (void)kind, (void)value; \
    return fmi2Discard; \
  }
STATUS(fmi2GetStatus, fmi2Status)
STATUS(fmi2GetIntegerStatus, int)
STATUS(fmi2GetBooleanStatus, fmi2Boolean)
STATUS(fmi2GetStringStatus, Text)
