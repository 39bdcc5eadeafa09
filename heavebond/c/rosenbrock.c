/* Integration of x' = f(t, x, z), 0 = g(t, x, z) by the Rosenbrock method Rodas5P: eight stages, order 5 with an error
   estimate of order 4, stiffly accurate and L-stable, for equations of index 1. It is a one-step method: a run continues
   from time, states and length of the next step with the same results as an uninterrupted run.
   G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within the Julia Differential
   Equations package, BIT Numerical Mathematics 63, 2023, doi:10.1007/s10543-023-00967-x (coefficients).
   E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 1996, IV.7 and VI.3 (form of the stages). */

enum { STAGES = 8, UNKNOWNS = model_n_x + model_n_z };

static const double GAMMA = 0.21193756319429014;
static const double A[STAGES][STAGES] = {
    {0},
    {3.0},
    {2.849394379747939, 0.45842242204463923},
    {-6.954028509809101, 2.489845061869568, -10.358996098473584},
    {2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641},
    {-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946},
    {-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946, 1},
    {-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946, 1, 1}};
static const double C[STAGES][STAGES] = {
    {0},
    {-14.155112264123755},
    {-17.97296035885952, -2.859693295451294},
    {147.12150275711716, -1.41221402718213, 71.68940251302358},
    {165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306},
    {24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471},
    {30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623, -28.087943162872662},
    {37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002, -54.66780262877968,
     -9.48861652309627}};
static const double ROUNDINGS = 32; /* roundings of the time in the stages, or in the source of a delay */
static const double TIMES[STAGES] = {0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664, 1, 1, 1};
static const double SLOPES[STAGES] = {0.21193756319429014, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734,
                                      2.325825639765069};

/* LU factors of a (by rows) in its place with the order of the rows; 0 if it is singular. */
static int factorise(int n, double *a, int *order) {
  int i, j, k;
  for (k = 0; k < n; ++k) {
    int pivot = k;
    for (i = k + 1; i < n; ++i)
      if (fabs(a[i * n + k]) > fabs(a[pivot * n + k])) pivot = i;
    order[k] = pivot;
    if (!(fabs(a[pivot * n + k]) > 0)) return 0;
    for (j = 0; j < n && pivot != k; ++j) {
      double kept = a[k * n + j];
      a[k * n + j] = a[pivot * n + j];
      a[pivot * n + j] = kept;
    }
    for (i = k + 1; i < n; ++i) {
      double factor = a[i * n + k] /= a[k * n + k];
      if (factor != 0)
        for (j = k + 1; j < n; ++j) a[i * n + j] -= factor * a[k * n + j];
    }
  }
  return 1;
}

static void back_substitute(int n, const double *a, const int *order, double *b) {
  int i, j;
  for (i = 0; i < n; ++i) {
    double kept = b[order[i]];
    b[order[i]] = b[i];
    b[i] = kept;
  }
  for (i = 0; i < n; ++i)
    for (j = 0; j < i; ++j) b[i] -= a[i * n + j] * b[j];
  for (i = n - 1; i >= 0; --i) {
    for (j = i + 1; j < n; ++j) b[i] -= a[i * n + j] * b[j];
    b[i] /= a[i * n + i];
  }
}

static double spacing(double t) { return nextafter(fabs(t), INFINITY) - fabs(t); }

/* One step of length h from y = (x, z) to `next`; the size of its error over the tolerance, or infinity if it fails. Far from 0
   the functions of time are rounded by more than the tolerance: what this adds to the last stage is not counted as an error. */
static double one_step(double t, const double *y, const double *p, const double *u, double h, const double *jacobian,
                       const double *slope, double tolerance, double *next) {
  static const int n = UNKNOWNS;
  double w[UNKNOWNS * UNKNOWNS + 1], k[STAGES][UNKNOWNS + 1], noise[UNKNOWNS + 1] = {0}, sum = 0;
  double rounding = ROUNDINGS * spacing(model_n_d ? u[model_n_v - 1] + t : t);
  int order[UNKNOWNS + 1], s, i, j;
  w[n * n] = 0, order[n] = 0; /* compilers warn of arrays without values if there are no unknowns */
  for (i = 0; i < n * n; ++i) w[i] = -jacobian[i];
  for (i = 0; i < model_n_x; ++i) w[i * n + i] += 1 / (h * GAMMA);
  if (!factorise(n, w, order)) return INFINITY;
  for (s = 0; s < STAGES; ++s) {
    for (i = 0; i < n; ++i) {
      next[i] = y[i];
      for (j = 0; j < s; ++j) next[i] += A[s][j] * k[j][i];
    }
    if (model_call(t + TIMES[s] * h, next, next + model_n_x, p, u, k[s], 0, k[s] + model_n_x, 0)) return INFINITY;
    for (i = 0; i < n; ++i) {
      k[s][i] += h * SLOPES[s] * slope[i];
      for (j = 0; j < s && i < model_n_x; ++j) k[s][i] += C[s][j] / h * k[j][i];
    }
    back_substitute(n, w, order, k[s]);
  }
  if (rounding > tolerance * h) {
    for (i = 0; i < n; ++i) noise[i] = rounding * slope[i];
    back_substitute(n, w, order, noise);
  }
  for (i = 0; i < n; ++i) {
    double nominal = i < model_n_x ? model_x_nominal[i] : model_z_nominal[i - model_n_x];
    double origin = i < model_n_x ? model_x_origin[i] : 0; /* of a state with small motions about it */
    double error = k[STAGES - 1][i];
    next[i] += error;
    error /= tolerance * (nominal + fmax(fabs(y[i] - origin), fabs(next[i] - origin))) + fabs(noise[i]);
    sum += error * error;
  }
  return isfinite(sum) ? sqrt(sum / (n ? n : 1)) : INFINITY;
}

/* The linearised equations at the beginning of a step, for steps of any length. */
typedef struct {
  double jacobian[UNKNOWNS * UNKNOWNS + 1], slope[UNKNOWNS + 1];
} Linear;

static int linearise(double t, const double *y, const double *p, const double *u, Linear *here) {
  const double *arg[] = {&t, y, y + model_n_x, p, u};
  double *res[] = {here->jacobian, here->slope};
  return model_jacobian(arg, res, 0, 0, 0);
}
