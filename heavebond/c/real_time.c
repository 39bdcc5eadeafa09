/* A run with a fixed step for real time. The memory is one block of constant size. No step allocates memory, and each
   iteration has a bound.

   A step consists of at most PARTS parts. A part ends at the end of the step, at a known instant, at the instant when a
   discontinuity leaves a delay, or when a condition becomes true. The instant of a condition is located by the regula falsi
   (Illinois) with at most LOCATING further steps of the method from the beginning of the part. Events that remain after the
   last part happen at the end of the step and are counted as late. A condition that becomes true and false again within
   one part is not detected.

   Methods: Euler and Runge-Kutta of order 4; backward Euler with one iteration of Newton's method (the linearly implicit
   Euler method); the Rosenbrock method of rosenbrock.c. The implicit methods factorise one matrix in each of their steps.
   E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 1993, II.1; E. Hairer, G. Wanner, II,
   1996, IV.7. M. Dowell, P. Jarratt, BIT Numerical Mathematics 11, 1971, 168-174 (Illinois). */
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "rosenbrock.c"

enum { PARTS = 4, LOCATING = 4, STENCIL = 6, LEVELS = 2, NO_LEVEL = 99 };
static const double TINY = 1e-140; /* values below it become 0: operations on denormal numbers take ten times as long */
static const double MARGIN = 1e-7; /* delay of an event after its condition, in steps, so that the condition is true */
static const double APART = 0.1;   /* least distance of two points of a stencil, over the distance of the two around a time */
static const char NO_DELAY[] = "a delay is not positive";
static const char SHORT_DELAY[] = "a delay is shorter than the step";
static const char LONG_DELAY[] = "a delay is longer than its ring buffer: set it in the diagram and export again";
static const char DELAY_IMPULSE[] = "a delayed variable jumps, and the equations need its rate";
static const char NOT_KNOWN[] = "the values became infinite: the step may be too long for the method";

/* the discontinuity at the present time, which the ring has not yet recorded: 0 a jump, 1 a kink, ... */
typedef struct {
  int level;
} History;

#include "values.c"

static const char *cut(Values *now, int level) {
  if (level < now->history.level) now->history.level = level;
  return NULL;
}

#include "fmu_events.c"

/* the sources of delayed variables at the ends of steps and on both sides of discontinuities */
typedef struct {
  long long number, next[model_n_d + 1]; /* next: for each delay, the first node that may be a discontinuity inside it */
  double t[model_ring], w[model_ring][model_n_d + 1];
  int level[model_ring]; /* level of the discontinuity just before the node, or NO_LEVEL */
} Ring;

struct model_run {
  Values now;
  Ring ring;
  long long steps, late;
  bool set; /* an input was set since the last step */
  int status;
  double y[model_n_y + 1];
  char message[model_n_m + 100];
};

/* -- delayed variables ------------------------------------------------------------------------------------------------- */
static const char *sources(const Values *now, double *w, double *T) {
  double t = clock_at(now, now->t), *res[] = {w, T};
  const double *arg[] = {&t, now->x, now->z, now->p, now->u};
  int k;
  if (model_histories(arg, res, 0, 0, 0)) return NO_SOLUTION;
  for (k = 0; T && k < model_n_d; ++k) {
    if (!(T[k] > 0)) return NO_DELAY;
    if (!(T[k] >= model_dt * (1 - 1e-9))) return SHORT_DELAY;
  }
  return NULL;
}

/* Record the sources at the present point, just after a discontinuity of a level. */
static const char *record(struct model_run *run, int level) {
  Ring *ring = &run->ring;
  Values *now = &run->now;
  int last = (int)((ring->number + model_ring - 1) % model_ring);
  bool there = ring->number && ring->t[last] == now->t;
  const char *wrong;
  now->history.level = NO_LEVEL;
  if (!model_n_d || (there && level == NO_LEVEL)) return NULL;
  if (there && ring->level[last] != NO_LEVEL) { /* the last node is just after a discontinuity */
    level = level < ring->level[last] ? level : ring->level[last];
  } else {
    last = (int)(ring->number++ % model_ring);
  }
  if ((wrong = evaluate(now)) != NULL) return wrong;
  ring->t[last] = now->t, ring->level[last] = level;
  return sources(now, ring->w[last], 0);
}

/* The instant at which the next discontinuity leaves delay k of length T. */
static double return_instant(Ring *ring, int k, double T) {
  if (ring->number - ring->next[k] > model_ring) ring->next[k] = ring->number - model_ring;
  while (ring->next[k] < ring->number && ring->level[ring->next[k] % model_ring] == NO_LEVEL) ++ring->next[k];
  return ring->next[k] < ring->number ? ring->t[ring->next[k] % model_ring] + T : INFINITY;
}

/* The polynomials of all delayed variables from now to `end`, as rows (1, t_0, r, c_0 ... c_7) of u: through nodes on one
   side of each discontinuity, by divided differences. */
static const char *set_pieces(struct model_run *run, double end) {
  const Ring *ring = &run->ring;
  Values *now = &run->now;
  double T[model_n_d + 1], middle = (now->t + end) / 2;
  const char *wrong = sources(now, 0, T);
  int k, i, j, n;
  for (k = 0; k < model_n_d && !wrong; ++k) {
    double *row = now->u + model_n_u + k * ROWS, s[STENCIL], c[STENCIL], at = middle - T[k], length;
    long long oldest = ring->number > model_ring ? ring->number - model_ring : 0, left = oldest, right = ring->number - 1;
    memset(row, 0, sizeof(double) * ROWS);
    if (at <= 0) continue; /* constant before the start */
    if (ring->t[oldest % model_ring] > at) return LONG_DELAY;
    while (right - left > 1) {
      long long m = (left + right) / 2;
      if (ring->t[m % model_ring] <= at) left = m;
      else right = m;
    }
    length = ring->t[right % model_ring] - ring->t[left % model_ring];
    if (right == left || !(length > 0)) { /* a single node, or both sides of a discontinuity */
      row[0] = 1, row[1] = middle, row[3] = ring->w[right % model_ring][k];
      continue;
    }
    for (n = 0; n < STENCIL; ++n) {
      long long node = n ? right : left, lower = left, upper = right;
      if (n > 1) {
        do lower = lower > oldest && ring->level[lower % model_ring] == NO_LEVEL ? lower - 1 : -1;
        while (lower >= 0 && ring->t[left % model_ring] - ring->t[lower % model_ring] < APART * length);
        do upper = upper + 1 < ring->number && ring->level[(upper + 1) % model_ring] == NO_LEVEL ? upper + 1 : -1;
        while (upper >= 0 && ring->t[upper % model_ring] - ring->t[right % model_ring] < APART * length);
        if (lower < 0 && upper < 0) break;
        if (upper < 0 || (lower >= 0 && at - ring->t[lower % model_ring] <= ring->t[upper % model_ring] - at))
          node = left = lower;
        else
          node = right = upper;
      }
      s[n] = (ring->t[node % model_ring] - at) / length;
      c[n] = ring->w[node % model_ring][k];
    }
    for (j = 1; j < n; ++j)
      for (i = n - 1; i >= j; --i) c[i] = (c[i] - c[i - 1]) / (s[i] - s[i - j]);
    for (i = n - 2; i >= 0; --i) /* from Newton's form to powers of s */
      for (j = i; j < n - 1; ++j) c[j] -= s[i] * c[j + 1];
    row[0] = 1, row[1] = middle, row[2] = 1 / length;
    memcpy(row + 3, c, sizeof(double) * (size_t)n);
  }
  now->fresh = false;
  return wrong;
}

/* Discontinuities that leave the delays now: the pieces of the delayed variables change. */
static const char *returned(struct model_run *run) {
  Values *now = &run->now;
  double T[model_n_d + 1], before[model_n_d + 1], end = now->t + model_dt, same = same_time(now);
  const char *wrong = sources(now, 0, T);
  int k, level = NO_LEVEL;
  for (k = 0; k < model_n_d && !wrong; ++k) {
    double instant;
    before[k] = delayed_now(now, k);
    while ((instant = return_instant(&run->ring, k, T[k])) <= now->t + same) {
      int next = run->ring.level[run->ring.next[k]++ % model_ring] + !model_direct;
      level = next < level ? next : level;
    }
    end = fmin(end, instant);
  }
  if (wrong || level == NO_LEVEL) return wrong;
  if ((wrong = set_pieces(run, end)) != NULL) return wrong;
  for (k = 0; k < model_n_d; ++k)
    if (model_d_rated[k] && fabs(delayed_now(now, k) - before[k]) > 1e-7 * model_d_nominal[k]) return DELAY_IMPULSE;
  return level <= LEVELS ? cut(now, level) : NULL;
}

/* -- steps ------------------------------------------------------------------------------------------------------------- */
/* One step of the method from y, the point of `from`, to `next`; false if it fails. */
static bool method_step(const Values *from, const double *y, const Linear *here, double h, double *next) {
  const double *p = from->p, *u = from->u;
  double t = clock_at(from, from->t);
  int n = UNKNOWNS, i, s;
  if (model_method == model_rosenbrock) {
    if (!isfinite(one_step(t, y, p, u, h, here->jacobian, here->slope, from->tolerance, next))) return false;
  } else if (model_method == model_backward_euler) {
    double w[UNKNOWNS * UNKNOWNS + 1], change[UNKNOWNS + 1];
    int order[UNKNOWNS + 1];
    Linear there;
    if (linearise(t + h, y, p, u, &there)) return false;
    if (model_call(t + h, y, y + model_n_x, p, u, change, 0, change + model_n_x, 0)) return false;
    for (i = 0; i < n * n; ++i) w[i] = -there.jacobian[i];
    for (i = 0; i < model_n_x; ++i) w[i * n + i] += 1 / h;
    if (!factorise(n, w, order)) return false;
    back_substitute(n, w, order, change);
    for (i = 0; i < n; ++i) next[i] = y[i] + change[i];
  } else if (model_method == model_euler) {
    for (i = 0; i < n; ++i) next[i] = y[i] + h * from->dx[i];
  } else {
    static const double share[] = {0, 0.5, 0.5, 1}, weight[] = {1, 2, 2, 1};
    double k[UNKNOWNS + 1], sum[UNKNOWNS + 1];
    for (s = 0; s < 4; ++s) {
      for (i = 0; i < n; ++i) next[i] = s ? y[i] + share[s] * h * k[i] : y[i];
      if (s ? model_call(t + share[s] * h, next, next + model_n_x, p, u, k, 0, 0, 0) : 0) return false;
      for (i = 0; i < n; ++i) {
        if (!s) k[i] = from->dx[i], sum[i] = 0;
        sum[i] += weight[s] * k[i];
      }
    }
    for (i = 0; i < n; ++i) next[i] = y[i] + h / 6 * sum[i];
  }
  for (i = 0; i < n; ++i) {
    if (!isfinite(next[i])) return false;
    if (fabs(next[i]) < TINY) next[i] = 0;
  }
  return true;
}

/* Of the conditions that become true in a part, the largest indicator relative to its change; a and b are the indicators at the
   beginning and at the end of the part. */
static double largest(const Values *now, const double *a, const double *b, const double *indicators) {
  double found = -INFINITY;
  int c;
  for (c = 0; c < model_n_c; ++c)
    if (!now->events.truth[c] && a[c] <= 0 && b[c] > 0) found = fmax(found, indicators[c] / (b[c] - a[c]));
  return found;
}

/* A part of a step to `end` or, with `locate`, to the first condition that becomes true before `end`; *early is then true. */
static const char *part(struct model_run *run, double end, bool locate, bool *early) {
  Values *now = &run->now;
  double y[UNKNOWNS + 1], next[UNKNOWNS + 1], best[UNKNOWNS + 1], a[model_n_c + 1], b[model_n_c + 1], at[model_n_c + 1];
  double low = 0, high = end - now->t, f_low, f_high, margin = MARGIN * model_dt;
  const char *wrong = NULL;
  Linear here;
  double begin_t = now->t, dx[model_n_x + 1];
  int k, side = 0;
  *early = false;
  if (model_n_d && (wrong = set_pieces(run, end)) != NULL) return wrong;
  if ((wrong = evaluate(now)) != NULL || (model_n_c && (wrong = indicate(now, a)) != NULL)) return wrong;
  memcpy(y, now->x, sizeof(double) * model_n_x);
  memcpy(y + model_n_x, now->z, sizeof(double) * model_n_z);
  memcpy(dx, now->dx, sizeof(double) * model_n_x);
  if (model_method == model_rosenbrock && linearise(clock_at(now, now->t), y, now->p, now->u, &here)) return NO_STEP;
  if (!method_step(now, y, &here, high, best)) return NOT_KNOWN;
  set_point(now, end, best);
  if (!model_n_c || !locate) return NULL;
  if ((wrong = indicate(now, b)) != NULL) return wrong;
  f_low = largest(now, a, b, a), f_high = largest(now, a, b, b);
  if (!(f_high > 0)) return NULL;
  for (k = 0; k < LOCATING; ++k) {
    double length = fmax(low - (high - low) * f_low / (f_high - f_low), low) + margin, f;
    if (!(length < high - margin)) break;
    set_point(now, begin_t, y);
    memcpy(now->dx, dx, sizeof(double) * model_n_x);
    if (!method_step(now, y, &here, length, next)) return NOT_KNOWN;
    set_point(now, begin_t + length, next);
    if ((wrong = indicate(now, at)) != NULL) return wrong;
    f = largest(now, a, b, at);
    if (f > 0) {
      high = length, f_high = f;
      memcpy(best, next, sizeof best);
      *early = true;
      if (side > 0) f_low /= 2;
      side = 1;
    } else {
      low = length, f_low = f;
      if (side < 0) f_high /= 2;
      side = -1;
    }
  }
  if (now->t != (*early ? begin_t + high : end)) set_point(now, *early ? begin_t + high : end, best);
  return NULL;
}

/* Execute the events that are due at the present point. */
static const char *events_now(struct model_run *run) {
  Values *now = &run->now;
  bool any, by_condition, sets;
  const char *wrong = NULL;
  if (model_n_d && ((wrong = record(run, NO_LEVEL)) != NULL || (wrong = returned(run)) != NULL)) return wrong;
  if ((wrong = due(now, &any, &by_condition)) != NULL) return wrong;
  if (any && ((wrong = happen(now, false, &sets)) != NULL || (wrong = limit_passed(now)) != NULL)) return wrong;
  return now->history.level == NO_LEVEL ? NULL : record(run, now->history.level);
}

static const char *step(struct model_run *run) {
  Values *now = &run->now;
  double end = (double)(run->steps + 1) * model_dt;
  const char *wrong = NULL;
  int k, n;
  if (run->set) {
    if (model_direct) cut(now, 0); /* the sources of delays jump with the inputs */
    if ((wrong = events_now(run)) != NULL) return wrong;
    run->set = false;
  }
  for (n = 1; now->t < end; ++n) {
    double T[model_n_d + 1], stop = INFINITY, same = same_instant(now);
    bool last = n == PARTS, early = false;
    if (model_n_e && (wrong = schedule(now)) != NULL) return wrong;
    if (model_n_e) stop = next_instant(now);
    if (model_n_d && (wrong = sources(now, 0, T)) != NULL) return wrong;
    for (k = 0; k < model_n_d; ++k) stop = fmin(stop, return_instant(&run->ring, k, T[k]));
    if (last || !(stop < end - same)) stop = end;
    if (last) ++run->late;
    if (stop > now->t && (wrong = part(run, stop, !last, &early)) != NULL) return wrong;
    if ((wrong = limit_passed(now)) != NULL || (wrong = events_now(run)) != NULL) return wrong;
  }
  return evaluate(now);
}

/* -- for the calling program --------------------------------------------------------------------------------------------- */
static int ended(struct model_run *run, const char *wrong) {
  if (!wrong) {
    memcpy(run->y, run->now.y, sizeof(double) * model_n_y);
    return 0;
  }
  if (wrong == run->now.message) snprintf(run->message, sizeof run->message, "%s", wrong);
  else snprintf(run->message, sizeof run->message, "%s (at %.12g s)", wrong, run->now.origin + run->now.t);
  return run->status = 1;
}

size_t model_size(void) { return sizeof(model_run); }

int model_init(model_run *run, const double *p) {
  Values *now = &run->now;
  const char *wrong;
  memset(run, 0, sizeof *run);
  begin(now);
  begin_at(now, model_t0);
  now->history.level = NO_LEVEL;
  if (p) memcpy(now->p, p, sizeof(double) * model_n_p);
  if ((wrong = end_start(now)) == NULL && (wrong = evaluate(now)) == NULL && (wrong = record(run, 0)) == NULL &&
      (wrong = events_now(run)) == NULL)
    wrong = evaluate(now);
  return ended(run, wrong);
}

int model_step(model_run *run) {
  const char *wrong;
  if (run->status) return run->status;
  if ((wrong = step(run)) == NULL) ++run->steps;
  return ended(run, wrong);
}

int model_set_input(model_run *run, int index, double value) {
  if (index < 0 || index >= model_n_u || !isfinite(value)) return 1;
  if (run->now.u[index] != value) run->now.u[index] = value, run->now.fresh = false, run->set = true;
  return 0;
}

double model_get_output(const model_run *run, int index) { return index < 0 || index >= model_n_y ? NAN : run->y[index]; }

double model_time(const model_run *run) { return model_t0 + (double)run->steps * model_dt; }

const char *model_message(const model_run *run) { return run->message; }

long long model_late(const model_run *run) { return run->late; }

static int found(const char *const *names, int n, const char *name) {
  int k;
  for (k = 0; k < n; ++k)
    if (name[0] && !strcmp(names[k], name)) return k;
  return -1;
}

int model_parameter_index(const char *name) { return found(model_parameter_names, model_n_p, name); }
int model_input_index(const char *name) { return found(model_input_names, model_n_u, name); }
int model_output_index(const char *name) { return found(model_output_names, model_n_y, name); }
