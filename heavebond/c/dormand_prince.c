/* The explicit method of order 5 with an embedded one of order 4 by J. R. Dormand and P. J. Prince (1980,
   doi:10.1016/0771-050X(80)90013-3), in place of CVODES for equations that are not stiff where steps are short beside the
   intervals between stops: what drives the model has a kink at every sample, behind which a method of several steps falls
   back, and an oscillation of a few samples a cycle asks for its highest orders. Six evaluations a step; the seventh is the
   first of the next one. Each step ends at the next stop at the latest, and every break of what drives the model is one. */

enum { STAGES = 7, ORDER = 5, TOO_MANY_STEPS = -1, TOO_MANY_FAILURES = -3, TOO_MANY_EVALUATIONS = -101 };

static const double NODES[STAGES] = {0.0, 1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1.0, 1.0};
static const double WEIGHTS[STAGES][STAGES - 1] = {
    {0},
    {1.0 / 5},
    {3.0 / 40, 9.0 / 40},
    {44.0 / 45, -56.0 / 15, 32.0 / 9},
    {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
    {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
    {35.0 / 384, 0.0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84}};
static const double ERRORS[STAGES] = {71.0 / 57600,      0.0,           -71.0 / 16695, 71.0 / 1920,
                                      -17253.0 / 339200, 22.0 / 525.0, -1.0 / 40};
/* At the same tolerances its runs err by a sixth to an eighth of those of CVODES, which keeps its estimate of the error of a
   step, not that of the run, below them: it may have looser ones. */
static const double LOOSER = 5.0;
/* Share of the step that the error would allow, and by how much a step may be shorter or longer than the one before. */
static const double SAFE = 0.9, SHORTER = 0.2, LONGER = 5.0, REFUSED = 0.25, ROUNDING = 1e-12, SHORTEST = 1e-14;

/* From `t` to `end`. The slopes at `t` stand in the first stage if `known`. 0, or one of the answers above. */
static int explicit_steps(Problem *problem, double t, double end, int known, double *reached, long *counts) {
  const long total = problem->total;
  double *x = problem->sundials->values(problem->x), *k[STAGES], *next = problem->stages + STAGES * total;
  long i, j, stage, steps = 0;
  for (stage = 0; stage < STAGES; ++stage) k[stage] = problem->stages + stage * total;
  while (t < end) {
    double wanted = problem->longest > 0 ? fmin(problem->step, problem->longest) : problem->step, error = 0.0, share;
    int last = wanted >= (end - t) * (1.0 - ROUNDING), bad = 0;
    double step = last ? end - t : wanted;
    if (counts[1] > problem->most_evaluations) return *reached = t, TOO_MANY_EVALUATIONS;
    if (++steps > problem->most_steps) return *reached = t, TOO_MANY_STEPS;
    if (!known) {
      ++counts[1];
      if (rates(problem, t, x, k[0])) return *reached = t, RIGHT_FAILED;
      known = 1;
    }
    for (stage = 1; stage < STAGES && !bad; ++stage) {
      for (i = 0; i < total; ++i) {
        double sum = 0.0;
        for (j = 0; j < stage; ++j) sum += WEIGHTS[stage][j] * k[j][i];
        next[i] = x[i] + step * sum;
      }
      ++counts[1];
      bad = rates(problem, t + NODES[stage] * step, next, k[stage]);
    }
    for (i = 0; i < total && !bad; ++i) {
      double sum = 0.0;
      for (stage = 0; stage < STAGES; ++stage) sum += ERRORS[stage] * k[stage][i];
      sum *= step / (LOOSER * (problem->rtol * fmax(fabs(x[i]), fabs(next[i])) + problem->atol));
      error += sum * sum;
    }
    error = sqrt(error / total);
    share = bad || !(error < HUGE_VAL) ? REFUSED : error > 0 ? SAFE * pow(error, -1.0 / ORDER) : LONGER;
    share = fmin(LONGER, fmax(SHORTER, share));
    if (bad || !(error <= 1.0)) {
      ++counts[2];
      problem->step = step * fmin(share, SAFE);
      if (problem->step < SHORTEST * fmax(fabs(t), fabs(end))) return *reached = t, bad ? RIGHT_FAILED : TOO_MANY_FAILURES;
      continue;
    }
    /* a step cut short by a stop says nothing against the one that the error allowed before */
    problem->step = step < problem->step ? fmax(problem->step, step * share) : step * share;
    ++counts[0];
    if (problem->sampled && (bad = passed(problem, t, step, x, next, k))) return *reached = t, bad;
    t = last ? end : t + step;
    if (problem->n_limits && (bad = within(problem, t, next))) {
      memcpy(x, next, total * sizeof(double));
      return *reached = t, bad;
    }
    memcpy(x, next, total * sizeof(double));
    memcpy(k[0], k[STAGES - 1], total * sizeof(double));
  }
  *reached = end;
  return 0;
}
