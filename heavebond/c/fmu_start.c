/* The start of the diagram for parameters and inputs that the importing program has set before the end of the initialisation:
   its conditions S(x, z, p) = 0, among them x' = 0 of a steady start. The solution is followed along a straight line from the
   values of the export to the new ones. Each step of the line begins where the guesses of the diagram move the start, and ends
   with Newton's method; unknowns that no condition determines change as little as they can, counted in their usual sizes.
   E. L. Allgower, K. Georg, Introduction to Numerical Continuation Methods, SIAM 2003. */

enum { START_UNKNOWNS = model_n_x + model_n_z + model_n_q, FULL_STEPS = 12, DAMPED_STEPS = 100, MOST_ROTATIONS = 60 };
static const double SOLVED = 1e-9;      /* largest residual of a solution, counted by its largest gradient */
static const double ACCEPTED = 1e-6;    /* the same where no step makes it smaller */
static const double SHORTEST_PART = 1e-3; /* of the line, below which a full step of Newton's method is given up */
static const double DEPENDENT = 1e-12;  /* share of the largest singular value below which one counts as zero */

/* the conditions at one point: residuals, gradients by rows, the same of the guesses, and the guesses themselves */
typedef struct {
  double *s, *by_s, *a, *by_a, *guess;
} Conditions;

static int start_conditions(const Values *now, const Conditions *at) {
  double t = clock_at(now, now->t);
  const double *arg[] = {&t, now->x, now->z, now->p, now->u};
  double *res[] = {at->s, at->by_s, at->a, at->by_a, at->guess};
  return model_starting(arg, res, 0, 0, 0);
}

static double *start_unknown(Values *now, int k) {
  return k < model_n_x ? &now->x[k] : k < model_n_x + model_n_z ? &now->z[k - model_n_x]
       : &now->p[model_start_solved[k - model_n_x - model_n_z]];
}

/* The least change d (n, in the place of the first row) with rows (m, n) d = right (m): the rows are turned until they are
   orthogonal. M. R. Hestenes, J. Soc. Indust. Appl. Math. 6 (1958) 51-90. */
static void least_change(int m, int n, double *rows, double *right, double *change) {
  double largest = 0;
  int round, i, j, k;
  bool turned = true;
  for (round = 0; round < MOST_ROTATIONS && turned; ++round)
    for (turned = false, i = 0; i < m; ++i)
      for (j = i + 1; j < m; ++j) {
        double aa = 0, bb = 0, ab = 0, tau, t, c, s, kept, *a = rows + i * n, *b = rows + j * n;
        for (k = 0; k < n; ++k) aa += a[k] * a[k], bb += b[k] * b[k], ab += a[k] * b[k];
        if (fabs(ab) <= 1e-15 * sqrt(aa * bb) || ab == 0) continue;
        tau = (bb - aa) / (2 * ab);
        t = (tau < 0 ? -1 : 1) / (fabs(tau) + sqrt(1 + tau * tau));
        c = 1 / sqrt(1 + t * t);
        s = c * t;
        for (k = 0; k < n; ++k) kept = a[k], a[k] = c * kept - s * b[k], b[k] = s * kept + c * b[k];
        kept = right[i], right[i] = c * kept - s * right[j], right[j] = s * kept + c * right[j];
        turned = true;
      }
  memset(change, 0, sizeof(double) * n);
  for (i = 0; i < m; ++i) {
    double square = 0;
    for (k = 0; k < n; ++k) square += rows[i * n + k] * rows[i * n + k];
    largest = fmax(largest, square);
  }
  for (i = 0; i < m; ++i) {
    double square = 0;
    for (k = 0; k < n; ++k) square += rows[i * n + k] * rows[i * n + k];
    if (square > DEPENDENT * DEPENDENT * largest)
      for (k = 0; k < n; ++k) change[k] += right[i] / square * rows[i * n + k];
  }
}

/* The change of the unknowns that takes the residuals (m) away, by their gradients (both are overwritten). */
static bool start_step(int m, double *residuals, double *gradients, double *change) {
  int i, k;
  for (i = 0; i < m; ++i) {
    double largest = 0, *row = gradients + i * START_UNKNOWNS;
    for (k = 0; k < START_UNKNOWNS; ++k) largest = fmax(largest, fabs(row[k] *= model_start_size[k]));
    if (!isfinite(largest) || !isfinite(residuals[i])) return false;
    if (!(largest > 0)) largest = 1;
    for (k = 0; k < START_UNKNOWNS; ++k) row[k] /= largest;
    residuals[i] /= -largest;
  }
  if (model_start_square && m == START_UNKNOWNS) {
    memcpy(change, residuals, sizeof(double) * m);
    if (!model_solve(m, gradients, change)) return false;
  } else {
    least_change(m, START_UNKNOWNS, gradients, residuals, change);
  }
  for (k = 0; k < START_UNKNOWNS; ++k) change[k] *= model_start_size[k];
  return true;
}

/* The largest residual, each counted by its largest gradient; infinite where one is no number. */
static double start_left(const Conditions *at) {
  double left = 0;
  int i, k;
  for (i = 0; i < model_n_s; ++i) {
    double largest = 0;
    for (k = 0; k < START_UNKNOWNS; ++k) largest = fmax(largest, fabs(at->by_s[i * START_UNKNOWNS + k]) * model_start_size[k]);
    left = fmax(left, fabs(at->s[i]) / (largest > 0 ? largest : 1));
    if (!isfinite(at->s[i])) return INFINITY;
  }
  return left;
}

/* Newton's method for all conditions; by full steps only, or halved until the residual falls. */
static bool start_newton(Values *now, const Conditions *at, bool halved) {
  double change[START_UNKNOWNS + 1], before[START_UNKNOWNS + 1], left, length;
  int turn, k, most = halved ? DAMPED_STEPS : FULL_STEPS;
  bool last = false;
  if (start_conditions(now, at)) return false;
  left = start_left(at);
  for (turn = 0; turn < most && isfinite(left) && !last; ++turn) {
    double next = INFINITY;
    last = left < SOLVED; /* one step more, to the rounding of the conditions */
    if (!start_step(model_n_s, at->s, at->by_s, change)) return left < ACCEPTED;
    for (k = 0; k < START_UNKNOWNS; ++k) before[k] = *start_unknown(now, k);
    for (length = 1; length > 1e-7; length /= 2) {
      for (k = 0; k < START_UNKNOWNS; ++k) *start_unknown(now, k) = before[k] + length * change[k];
      next = start_conditions(now, at) ? INFINITY : start_left(at);
      if (next < left || !halved || last) break;
    }
    if (!(next < left) && (last || left < ACCEPTED || halved)) { /* only rounding is left, or nothing helps */
      for (k = 0; k < START_UNKNOWNS; ++k) *start_unknown(now, k) = before[k];
      return left < ACCEPTED;
    }
    if (!(next < left)) return false;
    left = next;
  }
  return left < ACCEPTED;
}

/* The values of parameters and inputs at a part of the line, but for the parameters that the start determines. */
static void place_on_line(Values *now, const Values *goal, double part) {
  int k;
  for (k = 0; k < model_n_p; ++k)
    if (model_start_by_p[k]) now->p[k] = part < 1 ? (1 - part) * model_p_start[k] + part * goal->p[k] : goal->p[k];
  for (k = 0; k < model_n_u; ++k) now->u[k] = part < 1 ? (1 - part) * model_u_start[k] + part * goal->u[k] : goal->u[k];
}

/* One step on the line, from where the conditions hold. */
static bool start_part(Values *now, const Values *goal, double part, const Conditions *at, double *guess, double *aims,
                       bool halved) {
  double change[START_UNKNOWNS + 1];
  int k;
  if (start_conditions(now, at)) return false;
  memcpy(guess, at->guess, sizeof(double) * (model_n_x + model_n_z));
  memcpy(aims, at->a, sizeof(double) * model_n_a);
  place_on_line(now, goal, part);
  if (start_conditions(now, at)) return false;
  for (k = 0; k < model_n_x + model_n_z; ++k) *start_unknown(now, k) += at->guess[k] - guess[k];
  if (model_n_a) {
    if (start_conditions(now, at)) return false;
    for (k = 0; k < model_n_a; ++k) at->a[k] -= aims[k];
    if (!start_step(model_n_a, at->a, at->by_a, change)) return false;
    for (k = 0; k < START_UNKNOWNS; ++k) *start_unknown(now, k) += change[k];
  }
  return start_newton(now, at, halved);
}

static const char *solve_start(Values *now) {
  size_t n = START_UNKNOWNS, sizes[] = {model_n_s, model_n_s * n, model_n_a, model_n_a * n, n, n, model_n_a}, total = 0;
  double *memory, *parts[7], part = 0, step = 1;
  Values *goal;
  Conditions at;
  bool moved = false, halved = false;
  int k;
  if (!now->starting || now->own) return NULL;
  memcpy(now->x, model_x_start, sizeof(double) * model_n_x);
  memcpy(now->z, model_z_start, sizeof(double) * model_n_z);
  for (k = 0; k < model_n_q; ++k) now->p[model_start_solved[k]] = model_p_start[model_start_solved[k]];
  for (k = 0; k < model_n_p; ++k) moved = moved || (model_start_by_p[k] && now->p[k] != model_p_start[k]);
  for (k = 0; k < model_n_u; ++k) moved = moved || (model_start_by_u[k] && now->u[k] != model_u_start[k]);
  if (!moved) return NULL;
  for (k = 0; k < 7; ++k) total += sizes[k] + 1;
  memory = malloc(sizeof(double) * total);
  goal = malloc(sizeof *goal);
  if (!memory || !goal) return free(memory), free(goal), NO_START;
  for (parts[0] = memory, k = 1; k < 7; ++k) parts[k] = parts[k - 1] + sizes[k - 1] + 1;
  at.s = parts[0], at.by_s = parts[1], at.a = parts[2], at.by_a = parts[3], at.guess = parts[4];
  *goal = *now;
  place_on_line(now, goal, 0);
  while (part < 1 && step > 0) {
    Values before = *now;
    double next = halved ? 1 : fmin(1, part + step);
    if (start_part(now, goal, next, &at, parts[5], parts[6], halved)) {
      part = next;
      step *= 2;
    } else {
      *now = before;
      step = halved ? 0 : step / 2;
      halved = step < SHORTEST_PART; /* at last from there to the end, by damped steps */
    }
  }
  if (part < 1) *now = *goal;
  free(memory);
  free(goal);
  now->fresh = false;
  return part < 1 ? NO_START : NULL;
}
