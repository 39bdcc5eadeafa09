/* Steps of variable length, with control of the error. A condition that becomes true is detected in each step of the
   integrator: its indicator, or the cubic with its values and rates at both ends of the step, passes zero. The instant is
   located by Newton's method in a bracket, with a step to this instant. Events of time end a step exactly. */

enum { MOST_STEPS = 1000000, ITERATIONS = 80, HALVINGS = 14, PARTS = 8 };
static const double PRECISION = 1e-2; /* precision of an instant, relative to the difference of equal instants */
static const double SHORTEST = 1e-14; /* shortest step, which is not halved */
static const double LOOKS = 1e-3;     /* longest step between two evaluations of the conditions, relative to the run */
static const double SLIVER = 1e-3;    /* of a step: a shorter remainder before its target is added to it */
static const double REPEATED = 5;     /* error of the history, relative to the tolerance, above which a step is repeated */

/* Execute the events that are due; *changed is true if a state was set. */
static const char *update(Values *now, bool *changed) {
  bool any, by_condition;
  const char *wrong = due(now, &any, &by_condition);
  *changed = false;
  return wrong || !any ? wrong : happen(now, by_condition, changed);
}

/* One sufficiently accurate step from y at the present time towards `end`, to the point `next`; *h is the length of the step
   after it. Returns the time reached, or the present time if no step is short enough. */
static double accepted_step(const Values *now, double end, const double *y, const Linear *here, double *h, double *next) {
  double t = now->t;
  for (;;) {
    double length = fmin(*h, end - t);
    int last = length >= (end - t) * (1 - 1e-12);
    double error = one_step(clock_at(now, t), y, now->p, now->u, length, here->jacobian, here->slope, now->tolerance, next);
    if (error <= 1) {
      double growth = fmin(6, 0.9 * pow(fmax(error, 1e-12), -0.2));
      /* a step that `end` shortened does not determine the length of the next step, unless it must be shorter */
      if (length >= *h || growth < 1) *h = length * fmax(0.2, growth);
      return last ? end : t + length;
    }
    *h = length * (isfinite(error) ? fmax(0.2, 0.9 * pow(error, -0.2)) : 0.1);
    if (!(*h > 1e-14 * fmax(fabs(t), end - t))) return t;
  }
}

/* -- steps of co-simulation -------------------------------------------------------------------------------------------- */
/* A step of the integrator: its first point, and the last evaluated point in it. */
typedef struct {
  const Values *from;
  const double *y;
  const Linear *here;
  Values at;
  double indicators[model_n_c + 1], rates[model_n_c + 1], error;
} Span;

static const char *look_at(Span *span, double t) {
  const Values *from = span->from;
  double next[UNKNOWNS + 1];
  span->error = one_step(clock_at(from, from->t), span->y, from->p, from->u, t - from->t, span->here->jacobian,
                         span->here->slope, from->tolerance, next);
  set_point(&span->at, t, next);
  return look(&span->at, span->indicators, span->rates);
}

/* The inner extrema of the cubic with values a, b and rates c, d (for the whole step) at both ends. */
static void extremes(double a, double b, double c, double d, double *highest, double *lowest, double *most, double *least) {
  double shares[PARTS + 1], p = 3 * (c + d - 2 * (b - a)), q = 2 * (3 * (b - a) - 2 * c - d);
  double root = -(q + (q >= 0 ? 1 : -1) * sqrt(q * q - 4 * p * c)) / 2;
  int i;
  for (i = 0; i < PARTS - 1; ++i) shares[i] = (i + 1.0) / PARTS;
  shares[PARTS - 1] = root / p;
  shares[PARTS] = c / root;
  *most = -INFINITY, *least = INFINITY, *highest = *lowest = 0.5;
  for (i = 0; i <= PARTS; ++i) {
    double s = shares[i] > 0 && shares[i] < 1 ? shares[i] : 0.5;
    double r = 1 - s, value = (1 + 2 * s) * r * r * a + s * s * (3 - 2 * s) * b + s * r * r * c - s * s * r * d;
    if (value > *most) *most = value, *highest = s;
    if (value < *least) *least = value, *lowest = s;
  }
}

/* The time at which condition c becomes true between the beginning of a step and `end`, or INFINITY. `a` and `b` are its
   indicators, `ra` and `rb` the rates of its indicator at both. */
static const char *crossing(Span *span, int c, double end, double a, double b, double ra, double rb, double *found) {
  double begin = span->from->t, low = begin, high = end, highest, lowest, most, least, t;
  double precision = fmax(PRECISION * same_instant(span->from), spacing(fmax(fabs(begin), fabs(end))));
  bool left = span->from->events.truth[c], right = b > 0, certain;
  const char *wrong;
  int k;
  *found = INFINITY;
  extremes(a, b, (end - begin) * ra, (end - begin) * rb, &highest, &lowest, &most, &least);
  certain = !left && right;
  if (!certain && !(!left && !right && most > 0) && !(left && right && least < 0)) return NULL;
  if (left || a >= 0) { /* it must become false first, possibly for a very short time */
    for (k = 0; k <= (certain ? HALVINGS : 0); ++k) {
      t = begin + (end - begin) * (k ? pow(8, -k) : lowest);
      if ((wrong = look_at(span, t)) != NULL) return wrong;
      if (span->indicators[c] < 0) break;
    }
    if (k > (certain ? HALVINGS : 0)) {
      if (certain) *found = begin;
      return NULL;
    }
    low = t;
    if (!certain && !right) {
      high = begin + (end - begin) * highest;
      if (high <= low) return NULL;
    }
  } else if (!certain) {
    high = begin + (end - begin) * highest;
  }
  if (high < end) {
    if ((wrong = look_at(span, high)) != NULL) return wrong;
    if (!(span->indicators[c] > 0)) return NULL;
  }
  t = (low + high) / 2;
  for (k = 0; k < ITERATIONS; ++k) {
    double step;
    if ((wrong = look_at(span, t)) != NULL) return wrong;
    *(span->indicators[c] > 0 ? &high : &low) = t;
    step = span->rates[c] > 0 ? -span->indicators[c] / span->rates[c] : INFINITY;
    if (fabs(step) <= precision || high - low <= precision) break;
    t = low < t + step && t + step < high ? t + step : (low + high) / 2;
  }
  *found = k < ITERATIONS ? t : high;
  return NULL;
}

/* Mark the events of the first condition that becomes true in a step from `now` (with indicators a and their rates ra) to
   `next`; *next is then the point of these events. */
static const char *first_crossing(const Values *now, const double *y, const Linear *here, const double *a, const double *ra,
                                  Values *next, bool *crossed) {
  double b[model_n_c + 1], rb[model_n_c + 1], found, end = next->t, same = same_instant(now);
  const char *wrong = look(next, b, rb);
  Span span;
  int c, which = -1;
  *crossed = false;
  if (wrong) return wrong;
  span.from = now, span.y = y, span.here = here, span.at = *now;
  for (c = 0; c < model_n_c; ++c) {
    if ((wrong = crossing(&span, c, next->t, a[c], b[c], ra[c], rb[c], &found)) != NULL) return wrong;
    if (found < end || (found <= end && which < 0)) end = found, which = c;
  }
  if (which < 0) {
    for (c = 0; c < model_n_c; ++c) next->events.truth[c] = b[c] > 0 && !model_breaks[model_condition[c]];
    return NULL;
  }
  *crossed = true;
  if (end > now->t) {
    if ((wrong = look_at(&span, end)) != NULL) return wrong;
    if (!(span.error <= 1) && end - now->t > SHORTEST * fmax(fabs(end), now->events.span)) {
      *next = *now; /* there is a kink before it: the whole step was accurate, this part is not */
      next->step = (end - now->t) / 2;
      *crossed = false;
      return NULL;
    }
    span.at.step = next->step;
    *next = span.at;
  } else {
    *next = *now;
    if ((wrong = look(next, span.indicators, span.rates)) != NULL) return wrong;
  }
  for (c = 0; c < model_n_c; ++c) {
    bool soon = span.rates[c] > 0 && span.indicators[c] + span.rates[c] * same > 0;
    if (c == which || (soon && !now->events.truth[c])) next->events.met[model_condition[c]] = true;
    else if (!(span.indicators[c] > 0)) next->events.truth[c] = false;
  }
  return NULL;
}

/* One step of the integrator towards `end`, at most to the next event; *crossed is true if a condition becomes true there. */
static const char *advance(Values *now, double end, bool *crossed) {
  double y[UNKNOWNS + 1], reached_y[UNKNOWNS + 1], a[model_n_c + 1], ra[model_n_c + 1], reached,
         least = 0, target, planned;
  const char *wrong = NULL;
  Linear here;
  *crossed = false;
  if (model_longest > 0) end = fmin(end, now->t + model_longest);
  target = end;
  if (model_n_d) {
    double T[model_n_d + 1], shortest, longest;
    if ((wrong = delays(now, T, &shortest, &longest)) != NULL) return wrong;
    end = fmin(end, now->t + DELAY_SHARE * shortest);
    if (now->step > 0) end = fmin(end, now->t + (1 + 1e-9) * now->step); /* rounding must not shorten this step */
    if (target - end < SLIVER * (end - now->t)) end = target;
    if ((wrong = set_pieces(now, &end, &least)) != NULL) return wrong;
    if (!model_direct || !(least < INFINITY)) least = 0; /* a source that depends on the history is not smoother than the history */
  }
  wrong = evaluate(now);
  if (wrong || (model_n_c > 0 && (wrong = look(now, a, ra)) != NULL)) return wrong;
  memcpy(y, now->x, sizeof(double) * model_n_x);
  memcpy(y + model_n_x, now->z, sizeof(double) * model_n_z);
  if (linearise(clock_at(now, now->t), y, now->p, now->u, &here)) return NO_STEP;
  if (!(now->step > 0)) now->step = 1e-3 * (end - now->t);
  if (model_n_c) end = fmin(end, now->t + LOOKS * now->events.span);
  planned = now->step;
  reached = accepted_step(now, end, y, &here, &now->step, reached_y);
  if (!(reached > now->t)) return NO_STEP;
  if (model_n_d && now->step == planned && reached - now->t > 0.9 * planned) now->step *= 2; /* shorter by rounding only */
  if (model_n_c || model_n_d) {
    Values next = *now;
    set_point(&next, reached, reached_y);
    if (model_n_c && (wrong = first_crossing(now, y, &here, a, ra, &next, crossed)) != NULL) return wrong;
    if (model_n_d && next.t > now->t) {
      double error, length = next.t - now->t;
      if ((wrong = remember_step(now, y, &here, &next, &error)) != NULL) return wrong;
      if (error > REPEATED && length > fmax(64 * same_time(now), 1.5 * least)) { /* the history is not dense enough */
        now->step = fmax(least, length * fmax(0.2, 0.9 * pow(error, -1.0 / STENCIL)));
        *crossed = false;
        return NULL;
      }
      if (error > 1) next.step = fmin(next.step, fmax(least, 0.9 * length * pow(error, -1.0 / STENCIL)));
      else next.step = fmin(next.step, length * fmax(1, 0.9 * pow(fmax(error, 1e-12), -1.0 / STENCIL)));
    }
    *now = next;
  } else {
    set_point(now, reached, reached_y);
  }
  return NULL;
}

/* A step of co-simulation to the time `end`, with constant inputs; now->t is the time reached. With `stop` the step ends at the
   first event, *event is true, and `update` executes the event. */
static const char *do_step(Values *now, double end, bool stop, bool *event) {
  const char *wrong = evaluate(now); /* the algebraic unknowns for the inputs of this step */
  bool sets, any, by_condition, crossed = false;
  int steps;
  *event = false;
  if (wrong || (wrong = begin_history(now)) != NULL || (!stop && (wrong = update(now, &sets)) != NULL)) return wrong;
  for (steps = 0; now->t < end; ++steps) {
    double instant, same = same_instant(now), target, back = INFINITY;
    if (steps == MOST_STEPS) return NO_STEP;
    if ((wrong = schedule(now)) != NULL) return wrong;
    instant = model_n_e ? next_instant(now) : INFINITY;
    if (stop && instant <= now->t + same) {
      *event = true;
      return evaluate(now);
    }
    if (model_n_d && (wrong = next_return(now, &back)) != NULL) return wrong;
    instant = fmin(instant, fmax(back, now->t));
    target = instant < end - same ? instant : end;
    if ((wrong = advance(now, target, &crossed)) != NULL || (wrong = limit_passed(now)) != NULL) return wrong;
    if (!crossed && now->t < target) continue;
    if (model_n_d && (wrong = returned(now, &any)) != NULL) return wrong;
    if ((wrong = due(now, &any, &by_condition)) != NULL) return wrong;
    if (any && stop) {
      *event = true;
      return evaluate(now);
    }
    if (any && ((wrong = happen(now, by_condition, &sets)) != NULL || (wrong = limit_passed(now)) != NULL)) return wrong;
  }
  return evaluate(now);
}
