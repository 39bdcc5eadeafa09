/* What the wrappers of FMI 2.0 and 3.0 share: values by reference, evaluation, derivatives, and steps of co-simulation.
   Modelica Association, Functional Mock-up Interface Specification, https://fmi-standard.org */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "model.c"
#include "rosenbrock.c"

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

enum { PASSED = 500 }; /* events that are remembered, to tell those that come without end */

/* what the events of the diagram have done, and when those of time happen next */
typedef struct {
  bool known, truth[model_n_c + 1]; /* whether each condition is true, once it is known */
  bool met[model_n_e + 1];          /* events that are to happen now */
  bool timed;                       /* whether the instants belong to the parameters */
  double next[model_n_e + 1];       /* INFINITY: never again */
  double last[model_n_e + 1];       /* when it happened */
  double span, passed[PASSED];      /* length of the run, and instants of the last events, in a ring */
  int count;
} Happened;

/* all that changes: a copy of it is a snapshot, from which a run goes on to the last bit */
typedef struct {
  double t, x[model_n_x + 1], dx[model_n_x + 1], z[model_n_z + 1], p[model_n_p + 1], u[model_n_u + 1], y[model_n_y + 1];
  double step, tolerance; /* of the integrator of co-simulation */
  bool fresh;             /* whether dx, z and y belong to the rest */
  bool starting, own;     /* whether the start of the diagram follows parameters and inputs; unless a state was set */
  Happened events;
} Values;

/* a direction of all arguments, and what the results change along it */
typedef struct {
  double t, x[model_n_x + 1], z[model_n_z + 1], p[model_n_p + 1], u[model_n_u + 1];
  double dx[model_n_x + 1], y[model_n_y + 1], indicators[model_n_c + 1];
} Direction;

static const char NO_SOLUTION[] = "the algebraic equations have no solution here";
static const char NO_VARIABLE[] = "there is no variable with this value reference";
static const char NOT_FINITE[] = "a derivative is not finite";
static const char NO_SETTING[] = "only states, parameters and inputs can be set";
static const char NO_DERIVATIVE[] = "the algebraic equations have no derivative here";
static const char NO_KNOWN[] = "derivatives are taken by the time, states, parameters and inputs only";
static const char NO_UNKNOWN[] = "derivatives are known of the states' derivatives and of the outputs only";
static const char NO_STEP[] = "the integration does not get any further";
static const char NO_PERIOD[] = "an event would be repeated after a period that is not positive";
static const char NO_START[] = "the diagram has no start with these parameters and inputs that continues the exported one";
static const char CASCADE[] = "events set off each other without end";
static const char CHATTER[] = "events follow each other without end";
static const char IMPULSE[] = "an event makes jump what the equations differentiate";

/* Whether something has failed that depends on the values or the length of the step; else the call itself is wrong. */
static bool can_be_given_up(const char *wrong) {
  return wrong == NO_SOLUTION || wrong == NOT_FINITE || wrong == NO_DERIVATIVE || wrong == NO_STEP;
}

static void begin(Values *now) {
  int k;
  memset(now, 0, sizeof *now);
  memcpy(now->x, model_x_start, sizeof(double) * model_n_x);
  memcpy(now->z, model_z_start, sizeof(double) * model_n_z);
  memcpy(now->p, model_p_start, sizeof(double) * model_n_p);
  memcpy(now->u, model_u_start, sizeof(double) * model_n_u);
  now->tolerance = 1e-9;
  now->events.span = model_span;
  now->starting = model_n_s > 0;
  for (k = 0; k < model_n_e; ++k) now->events.last[k] = -INFINITY;
}

#include "fmu_start.c"

/* Rates, outputs and algebraic unknowns of the present values; what is wrong, or NULL. */
static const char *evaluate(Values *now) {
  const char *wrong;
  int k;
  if (now->fresh) return NULL;
  if ((wrong = solve_start(now)) != NULL) return wrong;
  if (model_evaluate(now->t, now->x, now->z, now->p, now->u, now->dx, now->y)) {
    memcpy(now->z, model_z_start, sizeof(double) * model_n_z); /* try from the first guess, once */
    if (model_evaluate(now->t, now->x, now->z, now->p, now->u, now->dx, now->y)) return NO_SOLUTION;
  }
  for (k = 0; k < model_n_x; ++k)
    if (!isfinite(now->dx[k])) return NOT_FINITE;
  now->fresh = true;
  return NULL;
}

/* The indicators of the conditions, of which one above zero is true. */
static const char *indicate(Values *now, double indicators[]) {
  const double *arg[] = {&now->t, now->x, now->z, now->p, now->u};
  double *res[] = {indicators, 0, 0, 0};
  const char *wrong = evaluate(now);
  return wrong ? wrong : model_happenings(arg, res, 0, 0, 0) ? NO_SOLUTION : NULL;
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
    values[k] = i == TIME ? now->t : i < RATES ? now->x[i - STATES] : i < PARAMETERS ? now->dx[i - RATES]
              : i < INPUTS ? now->p[i - PARAMETERS] : i < OUTPUTS ? now->u[i - INPUTS] : now->y[i - OUTPUTS];
  }
  return NULL;
}

static const char *set_values(Values *now, const Reference references[], size_t n, const double values[]) {
  size_t k;
  for (k = 0; k < n; ++k) {
    int i = (int)references[k];
    if (references[k] >= OUTPUTS || i == TIME || (i >= RATES && i < PARAMETERS)) return NO_SETTING;
    if (now->starting && i < RATES) { /* to set a state to the value of the export is no wish for it */
      if (values[k] == model_x_start[i - STATES] && !now->own) continue;
      now->own = true;
    }
    *(i < RATES ? &now->x[i - STATES] : i < INPUTS ? &now->p[i - PARAMETERS] : &now->u[i - INPUTS]) = values[k];
    if (i >= PARAMETERS && i < INPUTS) now->events.timed = false;
  }
  now->fresh = false;
  return NULL;
}

/* What the rates, the outputs, the residual of the algebraic equations and the indicators change along a direction of
   everything else. */
static int slopes(const Values *now, const Direction *along, double *dx, double *y, double *residual, double *indicators) {
  const double *arg[] = {&now->t, now->x, now->z, now->p, now->u, &along->t, along->x, along->z, along->p, along->u};
  double *res[] = {dx, y, residual, indicators};
  return model_directions(arg, res, 0, 0, 0);
}

/* As above, with the algebraic unknowns going along such that their equations hold: dg/dz z' = -(the rest of g'). */
static const char *directions(const Values *now, Direction *along) {
  double residual[model_n_z + 1], jacobian[model_n_z * model_n_z + 1];
  int k;
  if (model_n_z) {
    if (slopes(now, along, 0, 0, residual, 0) || model_call(now->t, now->x, now->z, now->p, now->u, 0, 0, 0, jacobian) ||
        !model_solve(model_n_z, jacobian, residual))
      return NO_DERIVATIVE;
    for (k = 0; k < model_n_z; ++k) along->z[k] = -residual[k];
  }
  return slopes(now, along, along->dx, along->y, 0, along->indicators) ? NO_DERIVATIVE : NULL;
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

/* The end of the initialisation: from here on states, parameters and inputs are what they are. */
static const char *end_start(Values *now) {
  const char *wrong = solve_start(now);
  now->starting = false;
  return wrong;
}

#include "fmu_events.c"
