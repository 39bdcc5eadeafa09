/* A run through samples: from one instant to the next by CVODES or by the one-step method, the updates of all blocks that are
   sampled at it, and so on, without a way back to Python at each.

   Targets are the instants, the output times and what else stops the integrator, in order. Between two of them a condition is
   quiet if the cubic through its indicators and rates at the ends of each step stays on one side of zero, by the signs of
   the coefficients in Bernstein form, which enclose it. Where one is not, and where anything fails, the state before is given
   back, and Python goes through that interval and the instant at its end.

   A method of several steps begins at its lowest order at each instant. After `TRIAL` intervals by CVODES, whose evaluations
   are counted, the one-step method takes over; where it takes more than `CHEAPER` times as many in an interval, CVODES makes
   that interval again and some more, twice as many each time. */

enum { ALL_DONE = 0, NOT_QUIET = 1, BUFFER_FULL = 2, HANDED_OVER = -102, TRIAL = 8, LONGEST_TRIAL = 4096, PARTS = 32,
       INNER_FROM = 2, INNER = 2 };

static const double CHEAPER = 1.5;

struct Sampled {
  long n_resets, n_held, n_conditions, first_flag, capacity;
  const int *reset_event, *reset_state, *reset_held; /* of each reset: its event, and the state or held variable, or -1 */
  const int *held, *held_row;                        /* of each held variable: its place in p, and among the directions */
  double *true_now, *values, *before;                /* conditions; indicators with their rates at the last point */
  double *kept_x, *kept_held, *new_values, *moved;   /* work: at the begin of an interval or before an instant */
  double *point_t, *point_x, *point_z;               /* points between the targets, `capacity` of them */
  long *point_target, points;                        /* the target that each lies before */
  double same, begin, end, last_point;
  long taken, trial, strikes, counted, intervals;
};

static int looked(Problem *problem, double t, const double *x, double *values) {
  struct Sampled *s = problem->sampled;
  long i;
  bind(problem, &problem->looked, t, x, driving(problem, t));
  evaluate(&problem->looked);
  for (i = 0; i < 2 * s->n_conditions; ++i) {
    values[i] = VALUE(&problem->looked, i);
    if (!isfinite(values[i])) return 1;
  }
  return 0;
}

/* Whether every condition keeps its truth over a step, from the values before to those now. */
static int quiet(const struct Sampled *s, double step) {
  long n = s->n_conditions, c;
  for (c = 0; c < n; ++c) {
    double sign = s->true_now[c] ? 1.0 : -1.0, a = sign * s->before[c], b = sign * s->values[c];
    double first = a + sign * step * s->before[n + c] / 3, last = b - sign * step * s->values[n + c] / 3;
    if (!(a > 0 && b > 0 && first > 0 && last > 0)) return 0;
  }
  return 1;
}

static int add_point(Problem *problem, double t, const double *x) {
  struct Sampled *s = problem->sampled;
  long n_z = problem->n_z, m = problem->m, k = s->points;
  if (k >= s->capacity) return HANDED_OVER;
  if (n_z) {
    if (complete(problem, t, x, driving(problem, t))) return HANDED_OVER;
    if (m) follow(problem, x);
    memcpy(s->point_z + k * n_z * (1 + m), problem->z, n_z * sizeof(double));
    memcpy(s->point_z + k * n_z * (1 + m) + n_z, problem->along, n_z * m * sizeof(double));
  }
  s->point_t[k] = t;
  s->point_target[k] = problem->piece;
  memcpy(s->point_x + k * problem->total, x, problem->total * sizeof(double));
  s->last_point = t;
  ++s->points;
  return 0;
}

/* After a step from t to `next`; with the stages of the one-step method, of which its continuous extension of order 4 (E.
   Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 1993, II.6) is made. */
static int passed(Problem *problem, double t, double step, const double *x, const double *next, double *const *k) {
  static const double D[7] = {-12715105075.0 / 11282082432, 0.0, 87487479700.0 / 32700410799, -10690763975.0 / 1880347072,
                              701980252875.0 / 199316789632, -1453857185.0 / 822651844, 69997945.0 / 29380423};
  struct Sampled *s = problem->sampled;
  double at = t + step;
  long i, j, inner, total = problem->total;
  ++s->taken;
  if (s->capacity && k && s->taken > INNER_FROM && step > (s->end - s->begin) / PARTS)
    for (inner = 1; inner <= INNER; ++inner) {
      double share = (double)inner / (INNER + 1), left = 1.0 - share, *point = s->kept_x + total;
      for (i = 0; i < total; ++i) {
        double rise = next[i] - x[i], bend = step * k[0][i] - rise, last = rise - step * k[6][i] - bend, more = 0.0;
        for (j = 0; j < 7; ++j) more += D[j] * k[j][i];
        point[i] = x[i] + share * (rise + left * (bend + share * (last + left * step * more)));
      }
      if (add_point(problem, t + share * step, point)) return HANDED_OVER;
    }
  if (s->capacity && at < s->end && at - s->last_point > (s->end - s->begin) / PARTS && add_point(problem, at, next))
    return HANDED_OVER;
  if (s->n_conditions) {
    if (problem->n_z && complete(problem, at, next, driving(problem, at))) return HANDED_OVER;
    if (looked(problem, at, next, s->values) || !quiet(s, step)) return HANDED_OVER;
    memcpy(s->before, s->values, 2 * s->n_conditions * sizeof(double));
  }
  return 0;
}

static void set_parameter(Problem *problem, long k, double value) {
  Tape *tapes[] = {&problem->right, &problem->full, &problem->signals, &problem->looked};
  long i;
  for (i = 0; i < 4; ++i)
    if (tapes[i]->slots) tapes[i]->slots[tapes[i]->n_constants + 1 + problem->n + problem->n_z + k] = value;
}

static void set_held(Problem *problem, long h, const double *from) { /* a value, then its moves along the directions */
  const struct Sampled *s = problem->sampled;
  double *directions = (double *)problem->directions;
  long j;
  set_parameter(problem, s->held[h], from[0]);
  for (j = 0; j < problem->m && s->held_row[h] >= 0; ++j) directions[j * problem->n_moving + s->held_row[h]] = from[1 + j];
}

static void get_held(const Problem *problem, double *out) { /* (n_held, 1 + m) by rows */
  const struct Sampled *s = problem->sampled;
  const Tape *tape = &problem->signals;
  long h, j, m = problem->m;
  for (h = 0; h < s->n_held; ++h) {
    out[h * (1 + m)] = tape->slots[tape->n_constants + 1 + problem->n + problem->n_z + s->held[h]];
    for (j = 0; j < m; ++j)
      out[h * (1 + m) + 1 + j] = s->held_row[h] < 0 ? 0.0 : problem->directions[j * problem->n_moving + s->held_row[h]];
  }
}

/* The state at a target, with z settled there. */
static int keep(Problem *problem, double t, const double *u, double *x_out, double *z_out) {
  const double *x = problem->sundials->values(problem->x);
  long n_z = problem->n_z, m = problem->m;
  memcpy(x_out, x, problem->total * sizeof(double));
  if (!n_z) return 0;
  if (complete(problem, t, x, u)) return 1;
  if (m) follow(problem, x);
  memcpy(z_out, problem->z, n_z * sizeof(double));
  memcpy(z_out + n_z, problem->along, n_z * m * sizeof(double));
  return 0;
}

/* The updates of the events `fired` at t; 1 where they are not quiet, with everything as it was. */
static int update(Problem *problem, double t, const double *u, const int *fired, long n_fired) {
  struct Sampled *s = problem->sampled;
  Tape *tape = &problem->signals;
  double *x = problem->sundials->values(problem->x);
  long n = problem->n, m = problem->m, total = problem->total, r, j, c, h;
  int bad = 0;
  memcpy(s->kept_x + total, x, total * sizeof(double));
  get_held(problem, s->kept_held);
  for (r = 0; r < n_fired; ++r) set_parameter(problem, s->first_flag + fired[r], 1.0);
  bind(problem, tape, t, x, u);
  evaluate(tape);
  for (r = 0; r < s->n_resets; ++r) s->new_values[r] = VALUE(tape, r);
  memset(s->moved, 0, s->n_resets * m * sizeof(double));
  if (m) multiply(problem, tape, &problem->signal_slopes, s->n_resets, s->n_resets, x, s->moved);
  for (r = 0; r < s->n_resets && !bad; ++r) {
    double from[1 + m];
    for (j = 0; j < n_fired && fired[j] != s->reset_event[r]; ++j) continue;
    if (j == n_fired) continue;
    from[0] = s->new_values[r];
    for (j = 0; j < m; ++j) from[1 + j] = s->moved[j * s->n_resets + r];
    for (j = 0; j <= m; ++j) bad |= !isfinite(from[j]);
    if (s->reset_state[r] >= 0)
      for (j = 0; j <= m; ++j) x[j * n + s->reset_state[r]] = from[j];
    if (s->reset_held[r] >= 0) set_held(problem, s->reset_held[r], from);
  }
  for (r = 0; r < n_fired; ++r) set_parameter(problem, s->first_flag + fired[r], 0.0);
  bad = bad || (problem->n_z && complete(problem, t, x, u));
  if (!bad && s->n_conditions) {
    bad = looked(problem, t, x, s->values);
    for (c = 0; c < s->n_conditions && !bad; ++c) {
      double value = s->values[c], near = fabs(s->values[s->n_conditions + c]) * s->same;
      bad = !(fabs(value) > near) || (value > 0 && !s->true_now[c]);
    }
    for (c = 0; c < s->n_conditions && !bad; ++c) s->true_now[c] = s->values[c] > 0;
  }
  if (!bad) return 0;
  memcpy(x, s->kept_x + total, total * sizeof(double));
  for (h = 0; h < s->n_held; ++h) set_held(problem, h, s->kept_held + h * (1 + m));
  return 1;
}

/* By CVODES from t to `end`. */
static int several_steps(Problem *problem, double t, double end, double *reached, long *counts) {
  const Sundials *s = problem->sundials;
  double *x = s->values(problem->x);
  int answer = s->stop_time(problem->memory, end);
  long number;
  for (number = 0; answer >= 0 && t < end; ++number) {
    if (number > problem->most_steps) return TOO_MANY_STEPS;
    if ((answer = s->step(problem->memory, end, problem->x, reached, ONE_STEP)) < 0) break;
    ++counts[0];
    if ((answer = passed(problem, t, *reached - t, x, x, 0))) return answer;
    t = *reached;
  }
  return answer < 0 ? answer : 0;
}

/* Put the state at the begin of a call; p (n_p,) with the flags of the events. */
void place(Problem *problem, const double *x, const double *z, const double *p, const double *held) {
  Tape *tapes[] = {&problem->right, &problem->full, &problem->signals, &problem->looked};
  long i;
  memcpy(problem->sundials->values(problem->x), x, problem->total * sizeof(double));
  if (problem->n_z) memcpy(problem->z, z, problem->n_z * sizeof(double));
  for (i = 0; i < 4; ++i) put(problem, tapes[i], p);
  for (i = 0; i < problem->sampled->n_held; ++i) set_held(problem, i, held + i * (1 + problem->m));
}

/* From t to `number` targets. `anew`: where the integrator begins anew after a target; `ends`: of the events at each among
   `fired`; `inputs` and `at`: what drives the model before and at each (n_u,). Written by rows: x and z before the events of
   each target and after them, and the held variables after them. `done` is the number of targets that were reached. */
int sample(Problem *problem, double t, long number, const double *times, const unsigned char *anew, const long *ends,
           const int *fired, const double *inputs, const double *at, double *x_before, double *z_before, double *x_after,
           double *z_after, double *held, long *counts, long *done) {
  const Sundials *sundials = problem->sundials;
  struct Sampled *s = problem->sampled;
  long total = problem->total, size_z = problem->n_z * (1 + problem->m), first = 0, first_points = 0, before = 0, k, now = 0;
  double *x = sundials->values(problem->x), t_first = t, reached = t;
  int begins = 1, known = 0, one_step = 0, again = 0, answer = 0;
  integrating = problem;
  problem->pieces = inputs;
  s->points = 0;
  for (k = 0; k < number;) {
    const double *u = at + k * problem->n_u;
    long from = k ? ends[k - 1] : 0;
    *done = k;
    problem->piece = k;
    if (begins) {
      if (s->capacity && s->points > s->capacity / 2) return BUFFER_FULL;
      first = k, first_points = s->points, t_first = t, known = 0;
      memcpy(s->kept_x, x, total * sizeof(double));
      one_step = !again && !s->trial;
      again = 0;
      if (!one_step && (answer = sundials->reinit(problem->memory, t, problem->x))) return NOT_QUIET;
      before = counts[1];
      problem->most_evaluations = before + (long)(CHEAPER * s->counted / (s->intervals ? s->intervals : 1)) + 2 * STAGES;
      if (s->n_conditions) {
        if (problem->n_z && complete(problem, t, x, driving(problem, t))) return NOT_QUIET;
        if (looked(problem, t, x, s->before)) return NOT_QUIET;
      }
    }
    s->begin = s->last_point = t, s->end = times[k], s->taken = 0;
    if (one_step) {
      if (!(problem->step > 0)) problem->step = times[k] - t;
      answer = explicit_steps(problem, t, times[k], known, &reached, counts);
      known = 1;
      if (answer && answer != HANDED_OVER) {
        s->trial = TRIAL << (s->strikes < 9 ? s->strikes++ : 9);
        s->counted = s->intervals = 0;
        memcpy(x, s->kept_x, total * sizeof(double));
        k = first, s->points = first_points, t = t_first, begins = again = 1;
        continue;
      }
    } else
      answer = several_steps(problem, t, times[k], &reached, counts);
    if (answer || keep(problem, times[k], u, x_before + k * total, z_before + k * size_z)) return NOT_QUIET;
    t = times[k];
    if (ends[k] > from) {
      if (update(problem, t, u, fired + from, ends[k] - from)) return NOT_QUIET;
      if (keep(problem, t, u, x_after + k * total, z_after + k * size_z)) return NOT_QUIET;
    } else {
      memcpy(x_after + k * total, x_before + k * total, total * sizeof(double));
      memcpy(z_after + k * size_z, z_before + k * size_z, size_z * sizeof(double));
    }
    get_held(problem, held + k * s->n_held * (1 + problem->m));
    begins = anew[k] || ends[k] > from;
    if (begins && !one_step) {
      sundials->evaluations(problem->memory, &now);
      counts[1] += now;
      s->counted += now, ++s->intervals;
      if (s->trial) --s->trial;
    }
    ++k;
  }
  *done = number;
  return ALL_DONE;
}
