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

typedef uint32_t Reference;

/* all that changes: a copy of it is a snapshot, from which a run goes on to the last bit */
typedef struct {
  double t, x[model_n_x + 1], dx[model_n_x + 1], z[model_n_z + 1], p[model_n_p + 1], u[model_n_u + 1], y[model_n_y + 1];
  double step, tolerance; /* of the integrator of co-simulation */
  bool fresh;             /* whether dx, z and y belong to the rest */
} Values;

static const char NO_SOLUTION[] = "the algebraic equations have no solution here";
static const char NO_VARIABLE[] = "there is no variable with this value reference";
static const char NOT_FINITE[] = "a derivative is not finite";
static const char NO_SETTING[] = "only states, parameters and inputs can be set";
static const char NO_DERIVATIVE[] = "the algebraic equations have no derivative here";
static const char NO_KNOWN[] = "derivatives are taken by the time, states, parameters and inputs only";
static const char NO_UNKNOWN[] = "derivatives are known of the states' derivatives and of the outputs only";
static const char NO_STEP[] = "the integration does not get any further";

static void begin(Values *now) {
  memset(now, 0, sizeof *now);
  memcpy(now->x, model_x_start, sizeof(double) * model_n_x);
  memcpy(now->z, model_z_start, sizeof(double) * model_n_z);
  memcpy(now->p, model_p_start, sizeof(double) * model_n_p);
  memcpy(now->u, model_u_start, sizeof(double) * model_n_u);
  now->tolerance = 1e-9;
}

/* Rates, outputs and algebraic unknowns of the present values; what is wrong, or NULL. */
static const char *evaluate(Values *now) {
  int k;
  if (now->fresh) return NULL;
  if (model_evaluate(now->t, now->x, now->z, now->p, now->u, now->dx, now->y)) {
    memcpy(now->z, model_z_start, sizeof(double) * model_n_z); /* try from the first guess, once */
    if (model_evaluate(now->t, now->x, now->z, now->p, now->u, now->dx, now->y)) return NO_SOLUTION;
  }
  for (k = 0; k < model_n_x; ++k)
    if (!isfinite(now->dx[k])) return NOT_FINITE;
  now->fresh = true;
  return NULL;
}

static const char *get_values(Values *now, const Reference references[], size_t n, double values[]) {
  size_t k;
  for (k = 0; k < n; ++k) {
    int i = (int)references[k];
    if (references[k] >= END) return NO_VARIABLE;
    if ((i >= RATES && i < PARAMETERS) || i >= OUTPUTS) {
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
    *(i < RATES ? &now->x[i - STATES] : i < INPUTS ? &now->p[i - PARAMETERS] : &now->u[i - INPUTS]) = values[k];
  }
  now->fresh = false;
  return NULL;
}

/* What the rates, the outputs and the residual of the algebraic equations change along a direction of everything else. */
static int slopes(const Values *now, const Values *along, double *dx, double *y, double *residual) {
  const double *arg[] = {&now->t, now->x, now->z, now->p, now->u, &along->t, along->x, along->z, along->p, along->u};
  double *res[] = {dx, y, residual};
  return model_directions(arg, res, 0, 0, 0);
}

/* As above, with the algebraic unknowns going along such that their equations hold: dg/dz z' = -(the rest of g'). */
static const char *directions(const Values *now, Values *along) {
  double residual[model_n_z + 1], jacobian[model_n_z * model_n_z + 1];
  int k;
  if (model_n_z) {
    if (slopes(now, along, 0, 0, residual) || model_call(now->t, now->x, now->z, now->p, now->u, 0, 0, 0, jacobian) ||
        !model_solve(model_n_z, jacobian, residual))
      return NO_DERIVATIVE;
    for (k = 0; k < model_n_z; ++k) along->z[k] = -residual[k];
  }
  return slopes(now, along, along->dx, along->y, 0) ? NO_DERIVATIVE : NULL;
}

static const char *derivative(Values *now, const Reference unknowns[], size_t n_unknowns, const Reference knowns[],
                              size_t n_knowns, const double seed[], double sensitivity[]) {
  Values along;
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
    sensitivity[k] = i < PARAMETERS ? along.dx[i - RATES] : along.y[i - OUTPUTS];
  }
  return NULL;
}

/* A step of co-simulation to the time `end`, with constant inputs; now->t is how far it came. */
static const char *do_step(Values *now, double end) {
  double y[UNKNOWNS + 1];
  const char *wrong = evaluate(now); /* the algebraic unknowns for the inputs of this step */
  int failed;
  if (wrong) return wrong;
  memcpy(y, now->x, sizeof(double) * model_n_x);
  memcpy(y + model_n_x, now->z, sizeof(double) * model_n_z);
  failed = integrate(now->t, end, y, now->p, now->u, now->tolerance, &now->step, &now->t);
  memcpy(now->x, y, sizeof(double) * model_n_x);
  memcpy(now->z, y + model_n_x, sizeof(double) * model_n_z);
  now->fresh = false;
  return failed ? NO_STEP : evaluate(now);
}
