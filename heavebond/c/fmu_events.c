/* Events of a run: their instants, the new values at an event, and the conditions that are due at a point. New values are set
   in the order of the updates. */

enum { CASCADES = 100, CHATTERING = 30 };
static const double CHATTER_SHARE = 1e-8, SLIDING_SHARE = 1e-4; /* of the run, in which CHATTERING or PASSED events are too many */
static const double REDUCED = 0.5; /* share of the force of a contact at its limit in the trial of a motion */
static const double HELD = 1e-4;   /* acceleration, over that without sticking contacts, of a body that other contacts hold */
static const double JUMP = 1e-7;   /* largest change of a continuous quantity at an event */

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
/* The next instant of each event of time: a single event in the past happens at once, a repeated one from now on. */
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
    double k, from = now->origin + (before ? events->last[i] + 2 * same : now->t - same);
    events->next[i] = INFINITY;
    if (!model_timed[i]) continue;
    if (!model_repeated[i]) {
      if (!before) events->next[i] = fmax(first[i] - now->origin, now->t);
      continue;
    }
    if (!(period[i] > 0)) return NO_PERIOD;
    k = fmax(0, ceil((fmax(from, now->origin + now->t - same) - first[i]) / period[i]));
    events->next[i] = first[i] + k * period[i] - now->origin;
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

/* -- new values -------------------------------------------------------------------------------------------------------- */
static const char *followed(Values *now, double values[]) {
  double t = clock_at(now, now->t), *res[] = {0, values, 0};
  const double *arg[] = {&t, now->x, now->z, now->p, now->u};
  const char *wrong = evaluate(now);
  return wrong ? wrong : model_happenings(arg, res, 0, 0, 0) ? NO_SOLUTION : NULL;
}

/* All marked events set their new values; *sets is true if an event sets a state. */
static const char *fire(Values *now, const bool marked[], bool *sets) {
  double values[model_n_r + 1] = {0}, fired[model_n_e + 1], t = clock_at(now, now->t);
  const double *arg[] = {&t, now->x, now->z, now->p, now->u, fired};
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

/* The changes of the accelerations of the contacts if the tried contacts give way; `loose`: no other contact sticks. */
static const char *give_way(const Values *now, const bool tried[], bool loose, double change[]) {
  int half, k;
  for (half = 0; half < 2; ++half) {
    Values trial = *now;
    double rates[model_n_b + 1], t = clock_at(now, now->t);
    const double *arg[] = {&t, trial.x, trial.z, trial.p, trial.u};
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

/* Reduce the tried contacts, which exceed their limits, to those that break away: each of them then moves with its force, and no
   other exceeds its limit; accelerations below HELD of those in `loose` are zero. Least-index pivoting of a linear complementarity
   problem: K. G. Murty, Opsearch 11 (1974) 123-130. */
static const char *breaking_away(const Values *now, bool tried[], const double loose[]) {
  bool broken[model_n_b + 1] = {false};
  int round, k, c;
  for (round = 0; round < CASCADES; ++round) {
    Values trial = *now;
    bool marked[model_n_e + 1] = {false}, sets;
    double rates[model_n_b + 1], excess[model_n_c + 1];
    const double *arg[] = {&trial.t, trial.x, trial.z, trial.p, trial.u};
    double *res[] = {0, 0, rates};
    const char *wrong;
    for (k = 0; k < model_n_b; ++k) marked[model_break_event[k]] = broken[k];
    if ((wrong = fire(&trial, marked, &sets)) != NULL || (wrong = indicate(&trial, excess)) != NULL) return wrong;
    if (model_happenings(arg, res, 0, 0, 0)) return NO_SOLUTION;
    for (k = 0; k < model_n_b; ++k) {
      if (!tried[k]) continue;
      for (c = 0; model_condition[c] != model_break_event[k];) ++c;
      if (broken[k] ? model_break_direction[k] * rates[k] < -HELD * fabs(loose[k]) : excess[c] > 0) break;
    }
    if (k == model_n_b) break;
    broken[k] = !broken[k];
  }
  memcpy(tried, broken, sizeof broken);
  return NULL;
}

/* Keep the marked breakaways after which the bodies move, and add the breakaways of contacts that were at their limits. The
   other contacts stay at their limits. If a contact would move against its force, all stick again if one of them was at its limit
   before, else only some break away. */
static const char *breaking(Values *now, bool marked[], bool *changed) {
  double held[model_n_b + 1], loose[model_n_b + 1];
  bool tried[model_n_b + 1], any = false, several = false, against = false, limited = false;
  const char *wrong;
  int k;
  *changed = false;
  for (k = 0; k < model_n_b; ++k) {
    bool at_limit = now->p[model_break_limit[k]] == model_break_direction[k];
    tried[k] = marked[model_break_event[k]] || at_limit;
    any = any || tried[k];
    limited = limited || at_limit;
    several = several || model_break_limit[k] != model_break_limit[0];
  }
  if (!any || !several) return NULL;
  if ((wrong = give_way(now, tried, false, held)) != NULL || (wrong = give_way(now, tried, true, loose)) != NULL) return wrong;
  for (k = 0; k < model_n_b; ++k)
    against = against || (tried[k] && fabs(held[k]) >= HELD * fabs(loose[k]) && model_break_direction[k] * held[k] < 0);
  if (against && !limited) {
    for (k = 0; k < model_n_b; ++k) marked[model_break_event[k]] = false;
    if ((wrong = breaking_away(now, tried, loose)) != NULL || (wrong = give_way(now, tried, false, held)) != NULL) return wrong;
    against = false;
  }
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

/* Execute the events that are marked in `met`, then the events whose conditions become true by this. */
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
      /* the condition of this event is true unless the motion leaves it at once; the reset made other conditions true */
      bool fired = marked[model_condition[c]];
      bool truth = indicators[c] + rates[c] * same > 0 && (fired || indicators[c] > 0);
      bool breaks = model_breaks[model_condition[c]]; /* happens whenever its condition is met */
      if (breaks ? indicators[c] > 0 : truth && !events->truth[c] && !fired) set_off[model_condition[c]] = again = true;
      events->truth[c] = truth && !breaks;
    }
    if (!again) { /* contacts at their limits may have lost their support */
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

/* Mark the events that are due at this point: reached instants, and conditions that became true, here or by other inputs. */
static const char *due(Values *now, bool *any, bool *by_condition) {
  double indicators[model_n_c + 1], rates[model_n_c + 1], same = same_instant(now);
  Happened *events = &now->events;
  const char *wrong;
  int i, c;
  *any = *by_condition = false;
  if (!model_n_e) return NULL;
  if ((wrong = schedule(now)) != NULL || (wrong = look(now, indicators, rates)) != NULL) return wrong;
  for (c = 0; c < model_n_c; ++c) {
    bool truth = indicators[c] + rates[c] * same > 0; /* a condition that ends at this instant, to rounding, is false */
    if (!events->known) {
      /* a condition that is true at the start is not a change, unless it depends on time alone; contacts break away from it */
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
