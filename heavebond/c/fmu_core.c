/* What the wrappers of FMI 2.0 and 3.0 share: values by reference and their derivatives.
   Modelica Association, Functional Mock-up Interface Specification, https://fmi-standard.org */
#include <stdint.h>

#include "model.c"
#include "run.c"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* value references: 0 is the time, then states, their derivatives, parameters (with what events hold), inputs, outputs,
   indicators of conditions */
enum {
  TIME = 0,
  STATES = 1,
  RATES = STATES + model_n_x,
  PARAMETERS = RATES + model_n_x,
  INPUTS = PARAMETERS + model_n_p,
  OUTPUTS = INPUTS + model_n_u,
  INDICATORS = OUTPUTS + model_n_y,
  END = INDICATORS + model_n_c
};

typedef uint32_t Reference;

static const char NO_EXCHANGE[] = "the history of delays is kept in co-simulation only";
static const char NO_VARIABLE[] = "there is no variable with this value reference";
static const char NO_SETTING[] = "only states, parameters and inputs can be set";
static const char NO_KNOWN[] = "derivatives are taken by the time, states, parameters and inputs only";
static const char NO_UNKNOWN[] = "derivatives are known of the states' derivatives and of the outputs only";

/* Whether something has failed that depends on the values or the length of the step; else the call itself is wrong. */
static bool can_be_given_up(const char *wrong) {
  return wrong == NO_SOLUTION || wrong == NOT_FINITE || wrong == NO_DERIVATIVE || wrong == NO_STEP;
}

static double absolute_time(const Values *now) { return now->origin + now->t; }

static void set_time(Values *now, double t) {
  now->fresh = now->fresh && t - now->origin == now->t;
  now->t = t - now->origin;
}

/* The begin of a step of co-simulation is the end of the last one, which the importing program may round otherwise. */
static void begin_step(Values *now, double t) {
  if (fabs(t - now->origin - now->t) > same_instant(now)) set_time(now, t);
}

static const char *get_values(Values *now, const Reference references[], size_t n, double values[]) {
  size_t k;
  for (k = 0; k < n; ++k) {
    int i = (int)references[k];
    if (references[k] >= END) return NO_VARIABLE;
    if (i >= INDICATORS) {
      double indicators[model_n_c + 1];
      const char *wrong = indicate(now, indicators);
      if (wrong) return wrong;
      values[k] = indicators[i - INDICATORS];
      continue;
    }
    if ((i >= RATES && i < PARAMETERS) || i >= OUTPUTS || (now->starting && i >= STATES && i < INPUTS)) {
      const char *wrong = evaluate(now);
      if (wrong) return wrong;
    }
    values[k] = i == TIME ? absolute_time(now) : i < RATES ? now->x[i - STATES] : i < PARAMETERS ? now->dx[i - RATES]
              : i < INPUTS ? now->p[i - PARAMETERS] : i < OUTPUTS ? now->u[i - INPUTS] : now->y[i - OUTPUTS];
  }
  return NULL;
}

static const char *set_values(Values *now, const Reference references[], size_t n, const double values[]) {
  size_t k;
  for (k = 0; k < n; ++k) {
    int i = (int)references[k];
    double *place;
    if (references[k] >= OUTPUTS || i == TIME || (i >= RATES && i < PARAMETERS)) return NO_SETTING;
    if (now->starting && i < RATES) { /* setting a state to the exported value does not replace the start */
      int specified = model_start_of_x[i - STATES];
      if (values[k] == model_x_start[i - STATES] && !now->own && specified < 0) continue;
      if (specified >= 0) now->p[specified] = values[k]; /* other states may follow from it */
      else now->own = true;
    }
    place = i < RATES ? &now->x[i - STATES] : i < INPUTS ? &now->p[i - PARAMETERS] : &now->u[i - INPUTS];
    now->history.set = now->history.set || *place != values[k];
    *place = values[k];
    if (i >= PARAMETERS && i < INPUTS) now->events.timed = false, now->unchecked = now->begun;
  }
  now->fresh = false;
  return NULL;
}

static const char *derivative(Values *now, const Reference unknowns[], size_t n_unknowns, const Reference knowns[],
                              size_t n_knowns, const double seed[], double sensitivity[]) {
  Direction along;
  const char *wrong;
  size_t k;
  memset(&along, 0, sizeof along);
  for (k = 0; k < n_knowns; ++k) {
    int i = (int)knowns[k];
    if (knowns[k] >= OUTPUTS || (i >= RATES && i < PARAMETERS)) return NO_KNOWN;
    *(i == TIME ? &along.t : i < RATES ? &along.x[i - STATES] : i < INPUTS ? &along.p[i - PARAMETERS]
      : &along.u[i - INPUTS]) = seed[k];
  }
  if ((wrong = evaluate(now)) != NULL || (wrong = directions(now, &along)) != NULL) return wrong;
  for (k = 0; k < n_unknowns; ++k) {
    int i = (int)unknowns[k];
    if (unknowns[k] >= END || i < RATES || (i >= PARAMETERS && i < OUTPUTS)) return NO_UNKNOWN;
    sensitivity[k] = i < PARAMETERS ? along.dx[i - RATES] : i < INDICATORS ? along.y[i - OUTPUTS]
                   : along.indicators[i - INDICATORS];
  }
  return NULL;
}
