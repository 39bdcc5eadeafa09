/* -- a run for the calling program ------------------------------------------------------------------------------------- */
size_t model_size(void) { return sizeof(Values); }

void model_begin(void *run, double t, const double *p) {
  Values *now = run;
  begin(now);
  begin_at(now, t);
  if (p) memcpy(now->p, p, sizeof(double) * model_n_p);
}

int model_advance(void *run, double until, const double *u, double *x, double *y, char *message, size_t size) {
  Values *now = run;
  double end = until - now->origin;
  const char *wrong = NULL;
  bool event;
  if (u && memcmp(now->u, u, sizeof(double) * model_n_u)) {
    memcpy(now->u, u, sizeof(double) * model_n_u);
    now->fresh = false;
    now->history.set = true;
  }
  if (!now->begun) wrong = end_start(now);
  if (!wrong && !(end >= now->t)) wrong = "the end of a step is before its begin";
  if (!wrong) wrong = do_step(now, end, false, &event);
  if (x) memcpy(x, now->x, sizeof(double) * model_n_x);
  if (y) memcpy(y, now->y, sizeof(double) * model_n_y);
  if (wrong == now->message && message) snprintf(message, size, "%s", wrong);
  else if (wrong && message) snprintf(message, size, "%s (at %.12g s)", wrong, now->origin + now->t);
  return wrong != NULL;
}
