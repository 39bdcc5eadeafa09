/* The values of a run, their evaluation and start. `History` is defined before. */
enum { PASSED = 500 }; /* number of stored events, to detect events without end */
enum { TERMS = 8, ROWS = 3 + TERMS }; /* of the polynomial of a delayed variable, and of its rows of u */

/* the state of the events of the diagram, and the next instants of events of time */
typedef struct {
  bool known, truth[model_n_c + 1]; /* truth of each condition, valid if `known` */
  bool met[model_n_e + 1];          /* events that must happen now */
  bool timed;                       /* true if the instants are valid for the parameters */
  double next[model_n_e + 1];       /* INFINITY: never again */
  double last[model_n_e + 1];       /* the last instant of each event */
  double span, passed[PASSED];      /* length of the run, and instants of the last events, in a ring */
  int count;
} Happened;

/* all variables of a run: a copy is a snapshot, from which a run continues with bit-equal results */
typedef struct {
  double origin, t; /* the time of the begin, and the time from there: it is not rounded far from 0 */
  double x[model_n_x + 1], dx[model_n_x + 1], z[model_n_z + 1], p[model_n_p + 1], u[model_n_v + 1], y[model_n_y + 1];
  double step, tolerance; /* of the integrator of co-simulation */
  bool fresh;             /* true if dx, z and y are valid for the other values */
  bool starting, own;     /* starting: the start follows parameters and inputs; own: a state was set instead */
  bool begun, unchecked;  /* begun: the initialisation has ended; unchecked: parameters were set after it */
  Happened events;
  History history;
  char message[model_n_m]; /* on a physical limit, or on the value of a parameter */
} Values;

/* a direction of all arguments, and the changes of the results along it */
typedef struct {
  double origin, t; /* the time of the begin, and the time from there: it is not rounded far from 0 */
  double x[model_n_x + 1], z[model_n_z + 1], p[model_n_p + 1], u[model_n_v + 1];
  double dx[model_n_x + 1], y[model_n_y + 1], indicators[model_n_c + 1];
} Direction;

static const double SAME = 1e-12; /* difference of equal instants, relative to the run */
static const char NO_SOLUTION[] = "the algebraic equations have no solution here";
static const char NOT_FINITE[] = "a derivative is not finite";
static const char NO_DERIVATIVE[] = "the algebraic equations have no derivative here";
static const char NO_STEP[] = "the integration does not get any further";
static const char NO_PERIOD[] = "an event would be repeated after a period that is not positive";
static const char NO_START[] = "the diagram has no start with these parameters and inputs that continues the exported one";
static const char CASCADE[] = "events set off each other without end";
static const char CHATTER[] = "events follow each other without end";
static const char IMPULSE[] = "an event sets a variable whose derivative the equations contain";

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

/* Set the time of the begin; with delays it is the last value of u. */
static void begin_at(Values *now, double t) {
  now->origin = t, now->t = 0, now->fresh = false;
  if (model_n_d) now->u[model_n_v - 1] = t;
}

/* The time argument of the equations at a time of the run: with delays it counts from the begin, as their history. */
static double clock_at(const Values *now, double t) { return model_n_d ? t : now->origin + t; }

#include "fmu_start.c"

/* The message of the first parameter whose value, or a value that follows from it, is not allowed, or NULL. */
static const char *refused(Values *now) {
  double value[model_n_g + 1];
  const double *arg[] = {now->p};
  double *res[] = {value};
  int k;
  now->unchecked = model_allowed(arg, res, 0, 0, 0) != 0;
  for (k = 0; k < model_n_g && !now->unchecked; ++k)
    if (!(value[k] >= model_g_low[k] && value[k] <= model_g_high[k])) {
      now->unchecked = true;
      if (model_g_rule[k][0])
        snprintf(now->message, sizeof now->message, "%s %.6g%s", model_g_name[k], value[k], model_g_rule[k]);
      else snprintf(now->message, sizeof now->message, "%s", model_g_name[k]);
      return now->message;
    }
  return now->unchecked ? NOT_FINITE : NULL;
}

/* Rates, outputs and algebraic unknowns of the present values; an error message, or NULL. */
static const char *evaluate(Values *now) {
  const char *wrong;
  double t = clock_at(now, now->t);
  int k;
  if (now->fresh) return NULL;
  if (now->unchecked && (wrong = refused(now)) != NULL) return wrong;
  if ((wrong = solve_start(now)) != NULL) return wrong;
  if (model_evaluate(t, now->x, now->z, now->p, now->u, now->dx, now->y)) {
    memcpy(now->z, model_z_start, sizeof(double) * model_n_z); /* try from the first guess, once */
    if (model_evaluate(t, now->x, now->z, now->p, now->u, now->dx, now->y)) return NO_SOLUTION;
  }
  for (k = 0; k < model_n_x; ++k)
    if (!isfinite(now->dx[k])) return NOT_FINITE;
  now->fresh = true;
  return NULL;
}

/* The message of a physical limit that this point exceeds, or NULL. */
static const char *limit_passed(Values *now) {
  const char *wrong = model_n_l ? evaluate(now) : NULL;
  if (wrong || !model_check(clock_at(now, now->t), now->x, now->z, now->p, now->u, now->message, sizeof now->message))
    return wrong;
  return now->message;
}

/* The indicators of the conditions; a condition is true if its indicator is above zero. */
static const char *indicate(Values *now, double indicators[]) {
  double t = clock_at(now, now->t), *res[] = {indicators, 0, 0};
  const double *arg[] = {&t, now->x, now->z, now->p, now->u};
  const char *wrong = evaluate(now);
  return wrong ? wrong : model_happenings(arg, res, 0, 0, 0) ? NO_SOLUTION : NULL;
}

/* The changes of the rates, the outputs, the residual of the algebraic equations and the indicators along a direction of all
   other values. */
static int slopes(const Values *now, const Direction *along, double *dx, double *y, double *residual, double *indicators) {
  double t = clock_at(now, now->t);
  const double *arg[] = {&t, now->x, now->z, now->p, now->u, &along->t, along->x, along->z, along->p, along->u};
  double *res[] = {dx, y, residual, indicators};
  return model_directions(arg, res, 0, 0, 0);
}

/* As above; the algebraic unknowns change so that their equations hold: dg/dz z' = -(the other terms of g'). */
static const char *directions(const Values *now, Direction *along) {
  double residual[model_n_z + 1], jacobian[model_n_z * model_n_z + 1];
  int k;
  if (model_n_z) {
    if (slopes(now, along, 0, 0, residual, 0) ||
        model_call(clock_at(now, now->t), now->x, now->z, now->p, now->u, 0, 0, 0, jacobian) || !model_solve(model_n_z, jacobian, residual))
      return NO_DERIVATIVE;
    for (k = 0; k < model_n_z; ++k) along->z[k] = -residual[k];
  }
  return slopes(now, along, along->dx, along->y, 0, along->indicators) ? NO_DERIVATIVE : NULL;
}

/* The end of the initialisation: the start no longer changes states, parameters and inputs. */
static const char *end_start(Values *now) {
  const char *wrong = refused(now);
  if (!wrong) wrong = solve_start(now);
  if (!wrong && model_n_q) wrong = refused(now); /* the start has solved for parameters */
  now->starting = false, now->begun = true;
  return wrong;
}

/* The difference of equal instants, which the equations and the calling program state by the time itself; and of two equal
   times of the run, from its begin. */
static double same_instant(const Values *now) { return fmax(SAME * now->events.span, 8 * spacing(now->origin + now->t)); }
static double same_time(const Values *now) { return fmax(SAME * now->events.span, 8 * spacing(now->t)); }

static void set_point(Values *now, double t, const double *y) {
  now->t = t;
  memcpy(now->x, y, sizeof(double) * model_n_x);
  memcpy(now->z, y + model_n_x, sizeof(double) * model_n_z);
  now->fresh = false;
}

/* The value of a delayed variable, by its polynomial; before the first source the value is constant. */
static double delayed_now(const Values *now, int k) {
  const double *row = now->u + model_n_u + k * ROWS;
  double value = 0, s = row[2] * (now->t - row[1]);
  int j;
  for (j = TERMS - 1; j >= 0; --j) value = value * s + row[3 + j];
  return row[0] > 0 ? value : now->p[model_d_before[k]];
}
