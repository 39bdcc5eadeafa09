
/* Test the physical limits at an accepted step: 0, or the number of the first variable below its limit, with a message. */
int MODEL_check(double t, const double *x, const double *z, const double *p, const double *u, char *message, size_t size) {
  double above[MODEL_n_l + 1], time;
  const double *arg[] = {&t, x, z, p, u};
  double *res[] = {above, &time};
  int k;
  if (MODEL_limits(arg, res, 0, 0, 0)) return 0;
  for (k = 0; k < MODEL_n_l; ++k)
    if (above[k] < -MODEL_l_grace[k]) {
      snprintf(message, size, "%s at %.12g s: %s", MODEL_l_text[k], time, MODEL_l_advice[k]);
      return k + 1;
    }
  return 0;
}
