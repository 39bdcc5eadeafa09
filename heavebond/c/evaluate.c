
/* Solve a d = b for n unknowns (a by rows, destroyed), d in the place of b; 0 where there is no solution. */
static int MODEL_solve(int n, double *a, double *b) {
  int i, j, k;
  for (k = 0; k < n; ++k) {
    int pivot = k;
    for (i = k + 1; i < n; ++i)
      if (fabs(a[i * n + k]) > fabs(a[pivot * n + k])) pivot = i;
    if (!(fabs(a[pivot * n + k]) > 0)) return 0;
    for (j = 0; j < n && pivot != k; ++j) {
      double kept = a[k * n + j];
      a[k * n + j] = a[pivot * n + j];
      a[pivot * n + j] = kept;
    }
    if (pivot != k) {
      double kept = b[k];
      b[k] = b[pivot];
      b[pivot] = kept;
    }
    for (i = k + 1; i < n; ++i) {
      double factor = a[i * n + k] / a[k * n + k];
      for (j = k; j < n; ++j) a[i * n + j] -= factor * a[k * n + j];
      b[i] -= factor * b[k];
    }
  }
  for (i = n - 1; i >= 0; --i) {
    for (j = i + 1; j < n; ++j) b[i] -= a[i * n + j] * b[j];
    b[i] /= a[i * n + i];
  }
  return 1;
}

/* The equations at one point; each of the results may be left out (a null pointer). */
static int MODEL_call(double t, const double *x, const double *z, const double *p, const double *u, double *dx,
                      double *y, double *residual, double *jacobian) {
  const double *arg[] = {&t, x, z, p, u};
  double *res[] = {dx, y, residual, jacobian};
  return MODEL_equations(arg, res, 0, 0, 0);
}

/* What is left of the algebraic equations, each counted by its largest gradient. */
static double MODEL_left(const double *residual, const double *weight) {
  double largest = 0;
  int i;
  for (i = 0; i < MODEL_n_z; ++i) {
    double one = fabs(residual[i]) * weight[i];
    if (!(one <= largest)) largest = one; /* also where it is no number */
  }
  return largest;
}

/* Newton's method for the algebraic unknowns, from the values that stand in z; 0 where it finds none. */
static int MODEL_loops(double t, const double *x, double *z, const double *p, const double *u) {
  double g[MODEL_n_z + 1], j[MODEL_n_z * MODEL_n_z + 1], weight[MODEL_n_z + 1], next[MODEL_n_z + 1];
  int turn, halving, i, k;
  for (turn = 0; turn < MODEL_turns; ++turn) {
    double size, step = 0, length = 1;
    if (MODEL_call(t, x, z, p, u, 0, 0, g, j)) return 0;
    for (i = 0; i < MODEL_n_z; ++i) {
      double slope = 0;
      for (k = 0; k < MODEL_n_z; ++k) slope = fmax(slope, fabs(j[i * MODEL_n_z + k]) * MODEL_z_nominal[k]);
      weight[i] = slope > 0 ? 1 / slope : 1;
    }
    size = MODEL_left(g, weight);
    if (!isfinite(size)) return 0;
    if (size == 0) return 1;
    if (!MODEL_solve(MODEL_n_z, j, g)) return 0;
    for (halving = 0; halving < MODEL_halvings; ++halving, length /= 2) {
      double residual[MODEL_n_z + 1];
      for (i = 0; i < MODEL_n_z; ++i) next[i] = z[i] - length * g[i];
      if (MODEL_call(t, x, next, p, u, 0, 0, residual, 0)) return 0;
      if (MODEL_left(residual, weight) < size) break;
    }
    for (i = 0; i < MODEL_n_z; ++i)
      step = fmax(step, fabs(g[i]) / (MODEL_z_nominal[i] + fabs(z[i])));
    /* at the end only rounding is left, which does not fall any more */
    if (halving == MODEL_halvings) return step < 1e-8;
    for (i = 0; i < MODEL_n_z; ++i) z[i] = next[i];
    if (step * length < 1e-13) return 1;
  }
  return 0;
}

int MODEL_evaluate(double t, const double *x, double *z, const double *p, const double *u, double *dx, double *y) {
  if (MODEL_n_z && !MODEL_loops(t, x, z, p, u)) return 1;
  return MODEL_call(t, x, z, p, u, dx, y, 0, 0) ? 2 : 0;
}
