/* Delayed variables: the history of their sources, and its polynomial pieces as inputs of the equations (method of steps).

   No step is longer than a quarter of the shortest delay, so that all delayed variables are known functions of time in a
   step. The sources are stored at the end of each step and at points inside it, and interpolated by polynomials of degree 7
   through points on one side of every discontinuity. A discontinuity at b (the start, an event, a jump of an input) returns
   at b + T: a step ends there, and a source that depends on the delayed variable has a discontinuity, too. With each return
   the discontinuity moves to a higher derivative, unless the source depends on the delayed variable without a state in
   between. The history is a ring in the memory of the run.
   A. Bellen, M. Zennaro, Numerical Methods for Delay Differential Equations, Oxford 2003, chap. 3, 4. */

enum { STENCIL = 8, FIRST_NODES = 8, FIRST_INNER = 6, INNER = 3, LEVELS = 8, PIECE_HALVINGS = 40 };
static const double APART = 0.25;        /* least distance of points of a stencil, over that of the two around a time */
static const double PIECE_ERROR = 0.1;   /* error of a piece over the tolerance of a step */
static const double DELAY_SHARE = 0.25;  /* longest step, relative to the shortest delay */
static const char NO_DELAY[] = "a delay is not positive";
static const char LONG_HISTORY[] = "a delay is too long for the steps of the integration: its history has too many points";
static const char MANY_BREAKS[] = "a delay is too long: too many discontinuities are on their way through it";
static const char DELAY_IMPULSE[] = "a delayed variable jumps, and the equations need its rate";

/* The sources and the delays at the present values. */
static const char *sources(double t, const double *x, const double *z, const double *p, const double *u, double *w, double *T) {
  const double *arg[] = {&t, x, z, p, u};
  double *res[] = {w, T};
  return model_histories(arg, res, 0, 0, 0) ? NO_SOLUTION : NULL;
}

static const char *delays(const Values *now, double T[], double *shortest, double *longest) {
  const char *wrong = sources(now->t, now->x, now->z, now->p, now->u, 0, T);
  int k;
  *shortest = INFINITY, *longest = 0;
  for (k = 0; k < model_n_d; ++k) {
    if (!(T[k] > 0)) return NO_DELAY;
    *shortest = fmin(*shortest, T[k]), *longest = fmax(*longest, T[k]);
  }
  return wrong;
}

/* Add a point to the present stretch; it replaces the last point if their times are equal. */
static const char *add_node(History *h, double t, const double *w, double longest) {
  int k, last = (h->number - 1) % NODES, at;
  if (h->number && h->stretch[last] == h->stretches && !(t > h->t[last])) {
    at = last;
  } else {
    at = h->number % NODES;
    if (h->number >= NODES && h->t[(at + STENCIL) % NODES] > t - longest) return LONG_HISTORY;
    ++h->number;
  }
  h->t[at] = t, h->stretch[at] = h->stretches;
  for (k = 0; k < model_n_d; ++k) {
    h->w[at][k] = w[k];
    h->largest[k] = fmax(h->largest[k], fabs(w[k]));
  }
  return NULL;
}

static const char *remember(Values *now) {
  double w[model_n_d + 1], T[model_n_d + 1], shortest, longest;
  const char *wrong = evaluate(now);
  if (wrong || (wrong = delays(now, T, &shortest, &longest)) != NULL) return wrong;
  if ((wrong = sources(now->t, now->x, now->z, now->p, now->u, w, 0)) != NULL) return wrong;
  return add_node(&now->history, now->t, w, longest);
}

/* A discontinuity at the present time, after which a new stretch begins. */
static const char *cut(Values *now, int level) {
  History *h = &now->history;
  int k, last = (h->number - 1) % NODES, latest = (h->breaks - 1) % BREAKS;
  if (!model_n_d) return NULL;
  if (h->breaks && h->at[latest] == now->t && h->number && h->stretch[last] == h->stretches && h->t[last] == now->t) {
    h->level[latest] = level < h->level[latest] ? level : h->level[latest]; /* the stretch has just begun */
    return remember(now);
  }
  for (k = 0; k < model_n_d; ++k)
    if (h->breaks - h->next[k] >= BREAKS) return MANY_BREAKS;
  h->at[h->breaks % BREAKS] = now->t;
  h->level[h->breaks % BREAKS] = level;
  ++h->breaks, ++h->stretches;
  return remember(now);
}

/* Node `k` counted from the first one ever. */
static double node_time(const History *h, int k) { return h->t[k % NODES]; }

/* The source of a delay at a time of the stretch from node `first` to `last`; without the node `out`, unless it is negative. */
static double interpolated(const History *h, int delay, int first, int last, double time, int out) {
  double nodes[STENCIL], values[STENCIL], found = 0, apart;
  int low = first, high = last, left, right, n = 0, i, j;
  if (first == last) return h->w[first % NODES][delay];
  while (high - low > 1) {
    int middle = (low + high) / 2;
    if (node_time(h, middle) <= time) low = middle;
    else high = middle;
  }
  left = low, right = low + 1;
  if (left == out && left > first) --left;
  if (right == out && right < last) ++right;
  apart = APART * (node_time(h, right) - node_time(h, left));
  nodes[n] = node_time(h, left), values[n++] = h->w[left % NODES][delay];
  nodes[n] = node_time(h, right), values[n++] = h->w[right % NODES][delay];
  while (n < STENCIL) {
    double a = node_time(h, left), b = node_time(h, right);
    int lower = left - 1, upper = right + 1;
    while (lower >= first && (lower == out || node_time(h, lower) > a - apart)) --lower;
    while (upper <= last && (upper == out || node_time(h, upper) < b + apart)) ++upper;
    if (lower < first && upper > last) break;
    if (upper > last || (lower >= first && time - node_time(h, lower) <= node_time(h, upper) - time)) left = i = lower;
    else right = i = upper;
    nodes[n] = node_time(h, i), values[n++] = h->w[i % NODES][delay];
  }
  for (i = 0; i < n; ++i) {
    double weight = 1;
    for (j = 0; j < n; ++j)
      if (j != i) weight *= (time - nodes[j]) / (nodes[i] - nodes[j]);
    found += weight * values[i];
  }
  return found;
}

/* The admissible error of a source, in a delay of length T. Far from 0 the functions of time in it are rounded. */
static double allowed(const Values *now, int delay, double T) {
  double largest = now->history.largest[delay], rounding = ROUNDINGS * spacing(now->origin + now->t);
  return fmax(now->tolerance, rounding / T) * (model_d_nominal[delay] + largest) + 1e-12 * largest;
}

/* The piece of a delayed variable from a to b as rows (v, t_0, r, c_0 ... c_7) of u, and its error over that allowed. *apart is
   the mean distance of the points around its middle. */
static double piece(const Values *now, int delay, double T, double a, double b, double *row, double *apart) {
  const History *h = &now->history;
  double matrix[TERMS * TERMS], middle = (a + b) / 2, half = (b - a) / 2, error = 0, scale;
  int first, last = h->number - 1, oldest = h->number > NODES ? h->number - NODES : 0, stretch, i, j;
  memset(row, 0, sizeof(double) * ROWS);
  *apart = INFINITY;
  if (middle - T <= h->begin || !(half > 0)) return 0; /* constant before the start */
  while (last > oldest && node_time(h, last) > middle - T) --last;
  stretch = h->stretch[last % NODES];
  i = last;
  for (first = last; first > oldest && h->stretch[(first - 1) % NODES] == stretch;) --first;
  while (last + 1 < h->number && h->stretch[(last + 1) % NODES] == stretch) ++last;
  if (first < last) {
    int low = i - STENCIL / 2 > first ? i - STENCIL / 2 : first, high = i + STENCIL / 2 < last ? i + STENCIL / 2 : last;
    *apart = (node_time(h, high) - node_time(h, low)) / (high - low);
  }
  for (i = 0; i < TERMS; ++i) {
    double s = cos(PI * (i + 0.5) / TERMS), power = 1;
    for (j = 0; j < TERMS; ++j, power *= s) matrix[i * TERMS + j] = power;
    row[3 + i] = interpolated(h, delay, first, last, middle - T + half * s, -1);
  }
  if (!model_solve(TERMS, matrix, row + 3)) return INFINITY;
  row[0] = 1, row[1] = middle, row[2] = 1 / half;
  scale = PIECE_ERROR * allowed(now, delay, T);
  for (i = 0; i <= TERMS; ++i) {
    double s = cos(PI * i / TERMS), value = 0;
    for (j = TERMS - 1; j >= 0; --j) value = value * s + row[3 + j];
    error = fmax(error, fabs(value - interpolated(h, delay, first, last, middle - T + half * s, -1)));
  }
  return error / scale;
}

/* Make the pieces of all delayed variables from now to *end, which is brought nearer where no polynomial follows. A piece over
   few points of the history errs as the interpolation between these; shorter ones would make the points of the next round closer.
   *least is the step of so many points. */
static const char *set_pieces(Values *now, double *end, double *least) {
  double T[model_n_d + 1], shortest, longest, *rows = now->u + model_n_u;
  const char *wrong = delays(now, T, &shortest, &longest);
  int halving, k;
  if (wrong) return wrong;
  for (halving = 0; halving < PIECE_HALVINGS; ++halving) {
    bool follows = true;
    *least = INFINITY;
    for (k = 0; k < model_n_d; ++k) {
      double apart, error = piece(now, k, T[k], now->t, *end, rows + k * ROWS, &apart);
      *least = fmin(*least, (1 + INNER) * apart);
      follows = follows && (error <= 1 || *end - now->t <= (1 + INNER) * apart);
    }
    if (follows) break;
    *end = now->t + (*end - now->t) / 2;
  }
  now->fresh = false;
  return NULL;
}

/* The first instant after now at which a discontinuity returns. */
static const char *next_return(const Values *now, double *instant) {
  const History *h = &now->history;
  double T[model_n_d + 1], shortest, longest;
  const char *wrong = delays(now, T, &shortest, &longest);
  int k;
  *instant = INFINITY;
  for (k = 0; k < model_n_d && !wrong; ++k)
    if (h->next[k] < h->breaks) *instant = fmin(*instant, h->at[h->next[k] % BREAKS] + T[k]);
  return wrong;
}

/* Discontinuities that return now: the pieces of the delayed variables change, and a source may then have a discontinuity. */
static const char *returned(Values *now, bool *any) {
  History *h = &now->history;
  double T[model_n_d + 1], shortest, longest, before[model_n_d + 1], end, same = same_time(now);
  const char *wrong = delays(now, T, &shortest, &longest);
  int k, level = LEVELS + 1;
  *any = false;
  for (k = 0; k < model_n_d && !wrong; ++k) {
    before[k] = delayed_now(now, k);
    for (; h->next[k] < h->breaks && h->at[h->next[k] % BREAKS] + T[k] <= now->t + same; ++h->next[k]) {
      int of = h->level[h->next[k] % BREAKS] + !model_direct;
      level = of < level ? of : level;
      *any = true;
    }
  }
  if (wrong || !*any) return wrong;
  end = now->t + DELAY_SHARE * shortest;
  if ((wrong = next_return(now, &longest)) != NULL) return wrong;
  end = fmin(end, longest);
  if ((wrong = set_pieces(now, &end, &longest)) != NULL) return wrong;
  for (k = 0; k < model_n_d; ++k)
    if (model_d_rated[k] && fabs(delayed_now(now, k) - before[k]) > 1e-7 * model_d_nominal[k]) return DELAY_IMPULSE;
  return level <= LEVELS ? cut(now, level) : evaluate(now);
}

/* The begin of a step of the caller: of the history, or where an input, a parameter or a state was set. */
static const char *begin_history(Values *now) {
  History *h = &now->history;
  if (!model_n_d || (h->begun && !h->set)) return NULL;
  if (!h->begun) h->begin = now->t;
  h->begun = true, h->set = false;
  return cut(now, 0);
}

/* Points inside an accepted step and at its end, for the history of `next`; `now` is its begin. *error is that of the
   interpolation at the middle of the step without the point there, about that near its end, over the one allowed. */
static const char *remember_step(const Values *now, const double *y, const Linear *here, Values *next, double *error) {
  History *h = &next->history;
  double T[model_n_d + 1], w[model_n_d + 1], shortest, longest, length = next->t - now->t;
  const char *wrong = delays(now, T, &shortest, &longest);
  int few = h->number < FIRST_NODES || h->stretch[(h->number - FIRST_NODES) % NODES] != h->stretches;
  int inner = few ? FIRST_INNER : INNER, i, k, first, last, out;
  for (i = 1; i <= inner && !wrong; ++i) {
    double at[UNKNOWNS + 1], share = few ? (1 - cos(PI * i / (inner + 1))) / 2 : (double)i / (inner + 1);
    double t = now->t + share * length;
    if (!(t > now->t && t < next->t)) continue;
    if (!(one_step(now->t, y, now->p, now->u, t - now->t, here->jacobian, here->slope, now->tolerance, at) < INFINITY)) continue;
    if (model_evaluate(t, at, at + model_n_x, now->p, now->u, 0, 0)) continue;
    if ((wrong = sources(t, at, at + model_n_x, now->p, now->u, w, 0)) == NULL) wrong = add_node(h, t, w, longest);
  }
  *error = 0;
  if (wrong || (wrong = remember(next)) != NULL) return wrong;
  last = h->number - 1, out = last - (inner + 1) / 2;
  for (first = last; first > 0 && first > last - 2 * STENCIL && h->stretch[(first - 1) % NODES] == h->stretches;) --first;
  if (last - first < FIRST_INNER) return NULL;
  for (k = 0; k < model_n_d; ++k) {
    double difference = interpolated(h, k, first, last, node_time(h, out), out) - h->w[out % NODES][k];
    *error = fmax(*error, fabs(difference) / allowed(next, k, T[k]));
  }
  return NULL;
}
