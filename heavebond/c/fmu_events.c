/* Events between and within the steps of co-simulation, and those that a program with an integrator of its own looks for.
   A condition that becomes true is found in each step of the integrator: where its indicator passes zero, or the cubic with
   its values and rates at both ends of the step does, the instant is found by Newton's method, in a bracket, with a step of
   that length. Events of time end a step exactly. New values follow the order of the updates. */

enum { MOST_STEPS = 1000000, CASCADES = 100, CHATTERING = 30, ITERATIONS = 80, HALVINGS = 14, PARTS = 8 };
static const double PRECISION = 1e-2; /* of an instant, as a share of that */
static const double CHATTER_SHARE = 1e-8, SLIDING_SHARE = 1e-4; /* of the run, in which CHATTERING or PASSED events are too many */
static const double SHORTEST = 1e-14; /* step that is not halved any more */
static const double LOOKS = 1e-3;     /* longest step between two looks at the conditions, as a share of the run */
static const double REDUCED = 0.5; /* share of its force that a contact at its limit keeps in the trial whether it moves */
static const double HELD = 1e-4;   /* share of the acceleration without sticking contacts below which others hold a body */
static const double SLIVER = 1e-3; /* of a step: a shorter rest before its target is added to it */
static const double REPEATED = 5; /* error of the history over that allowed from which on a step is made again */
static const double JUMP = 1e-7;      /* what a quantity may differ before and after an event and count as continuous */

/* Indicators and their rates along the motion. */
static const char *look(Values *now, double indicators[], double rates[]) {
  Direction along;
  const char *wrong = indicate(now, indicators);
  if (wrong || !model_n_c) return wrong;
  memset(&along, 0, sizeof along);
  along.t = 1;
  memcpy(along.x, now->dx, sizeof(double) * model_n_x);
  if ((wrong = directions(now, &along)) == NULL) memcpy(rates, along.indicators, sizeof(double) * model_n_c);
  return wrong;
}

/* -- instants of time ------------------------------------------------------------------------------------------------- */
/* When each event of time happens next: what happens once and has passed, at once; what is repeated, from now on. */
static const char *schedule(Values *now) {
  double first[model_n_e + 1], period[model_n_e + 1], same = same_instant(now);
  const double *arg[] = {now->p};
  double *res[] = {first, period};
  Happened *events = &now->events;
  int i;
  if (events->timed || !model_n_e) return NULL;
  if (model_instants(arg, res, 0, 0, 0)) return NO_SOLUTION;
  for (i = 0; i < model_n_e; ++i) {
    bool before = events->last[i] > -INFINITY;
    double k, from = before ? events->last[i] + 2 * same : now->t - same;
    events->next[i] = INFINITY;
    if (!model_timed[i]) continue;
    if (!model_repeated[i]) {
      if (!before) events->next[i] = fmax(first[i], now->t);
      continue;
    }
    if (!(period[i] > 0)) return NO_PERIOD;
    k = fmax(0, ceil((fmax(from, now->t - same) - first[i]) / period[i]));
    events->next[i] = first[i] + k * period[i];
  }
  events->timed = true;
  return NULL;
}

static double next_instant(const Values *now) {
  double found = INFINITY;
  int i;
  for (i = 0; i < model_n_e; ++i) found = fmin(found, now->events.next[i]);
  return found;
}

/* -- what happens ------------------------------------------------------------------------------------------------------ */
static const char *followed(Values *now, double values[]) {
  const double *arg[] = {&now->t, now->x, now->z, now->p, now->u};
  double *res[] = {0, values, 0};
  const char *wrong = evaluate(now);
  return wrong ? wrong : model_happenings(arg, res, 0, 0, 0) ? NO_SOLUTION : NULL;
}

/* All marked events set their new values; *sets says whether one sets a state. */
static const char *fire(Values *now, const bool marked[], bool *sets) {
  double values[model_n_r + 1], fired[model_n_e + 1];
  const double *arg[] = {&now->t, now->x, now->z, now->p, now->u, fired};
  double *res[] = {values};
  const char *wrong = evaluate(now);
  int i, row;
  if (wrong) return wrong;
  for (i = 0; i < model_n_e; ++i) fired[i] = marked[i];
  if (model_updates(arg, res, 0, 0, 0)) return NO_SOLUTION;
  for (i = 0; i < model_n_e; ++i)
    for (row = model_rows[i]; marked[i] && row < model_rows[i + 1]; ++row) {
      if (model_set_state[row] >= 0) now->x[model_set_state[row]] = values[row], *sets = true;
      if (model_set_held[row] >= 0) now->p[model_set_held[row]] = values[row];
    }
  now->fresh = false;
  return NULL;
}

/* What the accelerations of the contacts change if those that are tried give way; `loose`: without any other contact that
   sticks. */
static const char *give_way(const Values *now, const bool tried[], bool loose, double change[]) {
  int half, k;
  for (half = 0; half < 2; ++half) {
    Values trial = *now;
    double rates[model_n_b + 1];
    const double *arg[] = {&trial.t, trial.x, trial.z, trial.p, trial.u};
    double *res[] = {0, 0, rates};
    const char *wrong;
    for (k = 0; k < model_n_b && loose; ++k) trial.p[model_break_limit[k]] = REDUCED;
    for (k = 0; k < model_n_b; ++k)
      if (tried[k]) trial.p[model_break_limit[k]] = model_break_direction[k] * (half ? REDUCED : 1);
    trial.fresh = false;
    if ((wrong = evaluate(&trial)) != NULL) return wrong;
    if (model_happenings(arg, res, 0, 0, 0)) return NO_SOLUTION;
    for (k = 0; k < model_n_b; ++k) change[k] = half ? rates[k] - change[k] : rates[k];
  }
  return NULL;
}

/* Of the marked events, those breakaways remain after which the bodies move; breakaways of contacts that were at their
   limits join them. The other contacts stay at their limits, or all stick again where one would move against its force. */
static const char *breaking(Values *now, bool marked[], bool *changed) {
  double held[model_n_b + 1], loose[model_n_b + 1];
  bool tried[model_n_b + 1], any = false, several = false, against = false;
  const char *wrong;
  int k;
  *changed = false;
  for (k = 0; k < model_n_b; ++k) {
    tried[k] = marked[model_break_event[k]] || now->p[model_break_limit[k]] == model_break_direction[k];
    any = any || tried[k];
    several = several || model_break_limit[k] != model_break_limit[0];
  }
  if (!any || !several) return NULL;
  if ((wrong = give_way(now, tried, false, held)) != NULL || (wrong = give_way(now, tried, true, loose)) != NULL) return wrong;
  for (k = 0; k < model_n_b; ++k)
    against = against || (tried[k] && fabs(held[k]) >= HELD * fabs(loose[k]) && model_break_direction[k] * held[k] < 0);
  for (k = 0; k < model_n_b; ++k) {
    double *limit = &now->p[model_break_limit[k]], next = against ? 0 : model_break_direction[k];
    if (!tried[k]) continue;
    *changed = *changed || *limit != next;
    *limit = next;
    marked[model_break_event[k]] = !against && fabs(held[k]) >= HELD * fabs(loose[k]);
  }
  now->fresh = false;
  return NULL;
}

static const char *count_event(Values *now) {
  Happened *events = &now->events;
  double earlier = events->passed[(events->count + PASSED - CHATTERING + 1) % PASSED];
  double earliest = events->passed[(events->count + 1) % PASSED];
  events->passed[events->count++ % PASSED] = now->t;
  if (events->count >= CHATTERING && now->t - earlier < CHATTER_SHARE * events->span) return CHATTER;
  return events->count >= PASSED && now->t - earliest < SLIDING_SHARE * events->span ? CHATTER : NULL;
}

/* The events that are marked in `met` act, then those whose conditions become true by it. */
static const char *happen(Values *now, bool by_condition, bool *sets) {
  double before[model_n_f + 1], after[model_n_f + 1], indicators[model_n_c + 1], rates[model_n_c + 1];
  double same = same_instant(now);
  bool marked[model_n_e + 1];
  Happened *events = &now->events;
  const char *wrong = model_n_f ? followed(now, before) : NULL;
  int round, c, i;
  *sets = false;
  if (wrong || (by_condition && (wrong = count_event(now)) != NULL)) return wrong;
  memcpy(marked, events->met, sizeof marked);
  memset(events->met, 0, sizeof events->met);
  for (round = 0;; ++round) {
    bool again = false, changed, set_off[model_n_e + 1] = {false};
    if (round == CASCADES) return CASCADE;
    if ((wrong = breaking(now, marked, &changed)) != NULL) return wrong;
    for (i = 0; i < model_n_e; ++i)
      if (marked[i] && model_timed[i]) events->last[i] = events->next[i], events->timed = false;
    if ((wrong = fire(now, marked, sets)) != NULL || (wrong = look(now, indicators, rates)) != NULL) return wrong;
    for (c = 0; c < model_n_c; ++c) {
      /* what happened just now is true unless it is left at once; what else is true now became so by the reset */
      bool fired = marked[model_condition[c]];
      bool truth = indicators[c] + rates[c] * same > 0 && (fired || indicators[c] > 0);
      bool breaks = model_breaks[model_condition[c]]; /* happens whenever its condition is met */
      if (breaks ? indicators[c] > 0 : truth && !events->truth[c] && !fired) set_off[model_condition[c]] = again = true;
      events->truth[c] = truth && !breaks;
    }
    if (!again) { /* contacts at their limits may have lost what held them */
      if ((wrong = breaking(now, set_off, &changed)) != NULL) return wrong;
      for (i = 0; i < model_n_e; ++i) again = again || set_off[i];
      if (!again && !changed) break;
    }
    memcpy(marked, set_off, sizeof marked);
  }
  if ((wrong = schedule(now)) != NULL || (wrong = cut(now, 0)) != NULL || !model_n_f || *sets) return wrong;
  if ((wrong = followed(now, after)) != NULL) return wrong;
  for (i = 0; i < model_n_f; ++i)
    if (!(fabs(after[i] - before[i]) <= JUMP * model_f_size[i])) return IMPULSE;
  return NULL;
}

/* Mark what is due at this point: instants that have come, and conditions that became true, here or by other inputs. */
static const char *due(Values *now, bool *any, bool *by_condition) {
  double indicators[model_n_c + 1], rates[model_n_c + 1], same = same_instant(now);
  Happened *events = &now->events;
  const char *wrong;
  int i, c;
  *any = *by_condition = false;
  if (!model_n_e) return NULL;
  if ((wrong = schedule(now)) != NULL || (wrong = look(now, indicators, rates)) != NULL) return wrong;
  for (c = 0; c < model_n_c; ++c) {
    bool truth = indicators[c] + rates[c] * same > 0; /* what ends at this instant, to rounding, has ended */
    if (!events->known) {
      /* what is true at the start is no change, except a condition of the time alone; a contact breaks away from its start */
      events->truth[c] = indicators[c] > 0 && !model_breaks[model_condition[c]];
      if (events->truth[c] && model_clock[model_condition[c]]) events->met[model_condition[c]] = true;
    } else if (truth && !events->truth[c]) events->met[model_condition[c]] = true;
    else if (!truth) events->truth[c] = false;
  }
  events->known = true;
  for (i = 0; i < model_n_e; ++i) {
    if (events->next[i] <= now->t + same) events->met[i] = true;
    *any = *any || events->met[i];
    *by_condition = *by_condition || (events->met[i] && !model_timed[i]);
  }
  return NULL;
}

/* What is due happens; *changed says whether a state was set. */
static const char *update(Values *now, bool *changed) {
  bool any, by_condition;
  const char *wrong = due(now, &any, &by_condition);
  *changed = false;
  return wrong || !any ? wrong : happen(now, by_condition, changed);
}

/* -- steps of co-simulation -------------------------------------------------------------------------------------------- */
/* A step of the integrator: where it begins, and the point at a time within it that was looked at last. */
typedef struct {
  const Values *from;
  const double *y;
  const Linear *here;
  Values at;
  double indicators[model_n_c + 1], rates[model_n_c + 1], error;
} Span;

static void set_point(Values *now, double t, const double *y) {
  now->t = t;
  memcpy(now->x, y, sizeof(double) * model_n_x);
  memcpy(now->z, y + model_n_x, sizeof(double) * model_n_z);
  now->fresh = false;
}

static const char *look_at(Span *span, double t) {
  const Values *from = span->from;
  double next[UNKNOWNS + 1];
  span->error = one_step(from->t, span->y, from->p, from->u, t - from->t, span->here->jacobian, span->here->slope,
                         from->tolerance, next);
  set_point(&span->at, t, next);
  return look(&span->at, span->indicators, span->rates);
}

/* Where the cubic with values a, b and rates c, d (of the whole step) at both ends is highest and lowest inside. */
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

/* The time at which condition c becomes true between the begin of a step and `end`; INFINITY where it does not. `a` and `b`
   are its indicator and `ra` and `rb` its rates at both. */
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
  if (left || a >= 0) { /* it has to become false first, perhaps for a very short time */
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

/* The first condition that becomes true in a step from `now` (where the indicators are a, their rates ra) to `next`: its
   events are marked, and *next is the point where they happen. */
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
      *next = *now; /* a kink lies before it: the whole step was accurate, this part of it is not */
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

/* One step of the integrator towards `end`, at most to the next event; *crossed says that a condition becomes true there. */
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
    if (now->step > 0) end = fmin(end, now->t + (1 + 1e-9) * now->step); /* no rounding makes this step a shorter one */
    if (target - end < SLIVER * (end - now->t)) end = target;
    if ((wrong = set_pieces(now, &end, &least)) != NULL) return wrong;
    if (!model_direct || !(least < INFINITY)) least = 0; /* a source that follows the history itself is no smoother than that */
  }
  wrong = evaluate(now);
  if (wrong || (model_n_c > 0 && (wrong = look(now, a, ra)) != NULL)) return wrong;
  memcpy(y, now->x, sizeof(double) * model_n_x);
  memcpy(y + model_n_x, now->z, sizeof(double) * model_n_z);
  if (linearise(now->t, y, now->p, now->u, &here)) return NO_STEP;
  if (!(now->step > 0)) now->step = 1e-3 * (end - now->t);
  if (model_n_c) end = fmin(end, now->t + LOOKS * now->events.span);
  planned = now->step;
  reached = accepted_step(now->t, end, y, now->p, now->u, &here, now->tolerance, &now->step, reached_y);
  if (!(reached > now->t)) return NO_STEP;
  if (model_n_d && now->step == planned && reached - now->t > 0.9 * planned) now->step *= 2; /* shorter by rounding only */
  if (model_n_c || model_n_d) {
    Values next = *now;
    set_point(&next, reached, reached_y);
    if (model_n_c && (wrong = first_crossing(now, y, &here, a, ra, &next, crossed)) != NULL) return wrong;
    if (model_n_d && next.t > now->t) {
      double error, length = next.t - now->t;
      if ((wrong = remember_step(now, y, &here, &next, &error)) != NULL) return wrong;
      if (error > REPEATED && length > fmax(64 * same_instant(now), 1.5 * least)) { /* its history is not dense enough */
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

/* A step of co-simulation to the time `end`, with constant inputs; now->t is how far it came. With `stop` it ends where an
   event happens, which is left to `update`; *event says so. */
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
