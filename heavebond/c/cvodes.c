/* x' = f(t, x, p, u) integrated by the CVODES that CasADi brings, from the first to the last stop in one call.

   CVODES (BDF of variable order, Newton's method; A. C. Hindmarsh et al., 2005, doi:10.1145/1089014.1089020) is called by
   the addresses of its functions. The right-hand side and its Jacobian are lists of operations in static single assignment
   form over an array of slots: constants, then t, x, p and u, then results. The Jacobian of the states of the model (n of
   them) is that of every block of their forward sensitivities, so that each linear system is solved block by block with
   one factorisation. What follows the blocks (integrals) has no part in the Jacobian. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef void *N_Vector;
typedef int (*Side)(double, N_Vector, N_Vector, void *);
typedef int (*Setup)(double, N_Vector, N_Vector, int, int *, double, void *, N_Vector, N_Vector, N_Vector);
typedef int (*Solve)(double, N_Vector, N_Vector, N_Vector, N_Vector, double, double, int, void *, N_Vector);
typedef int (*Times)(N_Vector, N_Vector, double, N_Vector, N_Vector, void *, N_Vector);
typedef void (*Handler)(int, const char *, const char *, char *, void *);

/* The functions of SUNDIALS 2 in the order in which Python gives their addresses. */
typedef struct {
  void *(*create)(int, int);
  int (*init)(void *, Side, double, N_Vector);
  int (*reinit)(void *, double, N_Vector);
  int (*tolerances)(void *, double, double);
  int (*user_data)(void *, void *);
  int (*most_steps)(void *, long);
  int (*longest_step)(void *, double);
  int (*stop_time)(void *, double);
  int (*handler)(void *, Handler, void *);
  int (*gmres)(void *, int, int);
  int (*preconditioner)(void *, Setup, Solve);
  int (*jacobian_times)(void *, Times);
  int (*step)(void *, double, N_Vector, double *, int);
  int (*steps)(void *, long *);
  int (*evaluations)(void *, long *);
  int (*error_failures)(void *, long *);
  void (*release)(void **);
  N_Vector (*vector)(long);
  double *(*values)(N_Vector);
  void (*drop)(N_Vector);
} Sundials;

/* A function: `code` holds (operation, result, operand, operand) of each operation; `out` the slots of the outputs. */
typedef struct {
  long length, n_out, n_constants;
  const int *code, *out;
  double *slots;
} Tape;

typedef struct {
  const Sundials *sundials;
  Tape right, slope;
  long n, blocks, total, n_p, n_u, n_pieces, restart; /* restart: whether integration stops at each break */
  const int *rows, *columns;                          /* of the nonzeros of the Jacobian */
  const double *breaks, *pieces;                      /* (n_pieces + 1,), (n_u, n_pieces) by columns */
  long piece;
  double *jacobian, *lu, *inverse;
  int *pivots;
  void *memory;
  N_Vector x;
} Problem;

enum { BDF = 2, NEWTON = 2, NORMAL = 1, LEFT = 1, BASES = 5 };

/* Each operation jumps to the next by itself, which a processor predicts better than one switch for all; LABELS and
   OPERATIONS are made of one table in Python, whose last operation ends the list. */
static void evaluate(const Tape *tape) {
  static const void *const labels[] = {LABELS};
  double *const w = tape->slots;
  const int *c = tape->code;
#define A w[c[2]]
#define B w[c[3]]
#define OPERATION(name, value) \
  name:                        \
  w[c[1]] = value;             \
  c += 4;                      \
  goto *labels[*c];
  goto *labels[*c];
  OPERATIONS
END:
  return;
}

/* Put t, x and what drives the model there into the slots of a function; p stands there since the run began. */
static void bind(Problem *problem, Tape *tape, double t, const double *x) {
  double *w = tape->slots + tape->n_constants;
  *w++ = t;
  memcpy(w, x, problem->total * sizeof(double));
  if (problem->n_u) {
    const double *breaks = problem->breaks;
    if (!problem->restart) {
      long k = problem->piece;
      while (k + 1 < problem->n_pieces && t >= breaks[k + 1]) ++k;
      while (k > 0 && t < breaks[k]) --k;
      problem->piece = k;
    }
    memcpy(w + problem->total + problem->n_p, problem->pieces + problem->piece * problem->n_u,
           problem->n_u * sizeof(double));
  }
}

static int right(double t, N_Vector x, N_Vector rates, void *data) {
  Problem *problem = data;
  double *out = problem->sundials->values(rates);
  const Tape *tape = &problem->right;
  long k;
  bind(problem, &problem->right, t, problem->sundials->values(x));
  evaluate(tape);
  for (k = 0; k < tape->n_out; ++k) {
    out[k] = tape->slots[tape->out[k]];
    if (!isfinite(out[k])) return 1;
  }
  return 0;
}

/* The Jacobian at a point, and I - gamma J = P' L U. */
static int setup(double t, N_Vector x, N_Vector rates, int known, int *renewed, double gamma, void *data, N_Vector a,
                 N_Vector b, N_Vector c) {
  Problem *problem = data;
  const Tape *tape = &problem->slope;
  long n = problem->n, i, j, k;
  double *lu = problem->lu;
  *renewed = !known;
  if (!known) {
    bind(problem, &problem->slope, t, problem->sundials->values(x));
    evaluate(tape);
    memset(problem->jacobian, 0, n * n * sizeof(double));
    for (k = 0; k < tape->n_out; ++k)
      problem->jacobian[problem->rows[k] * n + problem->columns[k]] = tape->slots[tape->out[k]];
  }
  for (k = 0; k < n * n; ++k) lu[k] = -gamma * problem->jacobian[k];
  for (k = 0; k < n; ++k) lu[k * n + k] += 1.0;
  for (k = 0; k < n; ++k) {
    long best = k;
    for (i = k + 1; i < n; ++i)
      if (fabs(lu[i * n + k]) > fabs(lu[best * n + k])) best = i;
    if (!(fabs(lu[best * n + k]) > 0)) return 1;
    problem->pivots[k] = (int)best;
    for (j = 0; j < n && best != k; ++j) {
      double kept = lu[k * n + j];
      lu[k * n + j] = lu[best * n + j];
      lu[best * n + j] = kept;
    }
    for (i = k + 1; i < n; ++i) {
      double factor = lu[i * n + k] /= lu[k * n + k];
      if (factor != 0.0)
        for (j = k + 1; j < n; ++j) lu[i * n + j] -= factor * lu[k * n + j];
    }
    problem->inverse[k] = 1.0 / lu[k * n + k];
  }
  return 0;
}

static int solve(double t, N_Vector x, N_Vector rates, N_Vector given, N_Vector found, double gamma, double delta,
                 int side, void *data, N_Vector a) {
  Problem *problem = data;
  long n = problem->n, block, i, j;
  const double *lu = problem->lu;
  double *z = problem->sundials->values(found);
  memcpy(z, problem->sundials->values(given), problem->total * sizeof(double));
  for (block = 0; block < problem->blocks; ++block, z += n) {
    for (i = 0; i < n; ++i) {
      double kept = z[problem->pivots[i]];
      z[problem->pivots[i]] = z[i];
      z[i] = kept;
    }
    for (i = 1; i < n; ++i) {
      double left = z[i];
      for (j = 0; j < i; ++j) left -= lu[i * n + j] * z[j];
      z[i] = left;
    }
    for (i = n - 1; i >= 0; --i) {
      double left = z[i];
      for (j = i + 1; j < n; ++j) left -= lu[i * n + j] * z[j];
      z[i] = left * problem->inverse[i];
    }
  }
  return 0;
}

static int times(N_Vector given, N_Vector found, double t, N_Vector x, N_Vector rates, void *data, N_Vector a) {
  Problem *problem = data;
  long n = problem->n, block, i, j;
  const double *v = problem->sundials->values(given);
  double *z = problem->sundials->values(found);
  for (block = 0; block < problem->blocks; ++block, z += n, v += n)
    for (i = 0; i < n; ++i) {
      const double *row = problem->jacobian + i * n;
      double sum = 0.0;
      for (j = 0; j < n; ++j) sum += row[j] * v[j];
      z[i] = sum;
    }
  memset(z, 0, (problem->total - n * problem->blocks) * sizeof(double));
  return 0;
}

static void silent(int code, const char *module, const char *function, char *message, void *data) {}

/* Prepare a problem; 0, or what CVODES answers. */
int prepare(Problem *problem, double t, double rtol, double atol, long most_steps, double longest) {
  const Sundials *s = problem->sundials;
  int bad = 0;
  problem->x = s->vector(problem->total);
  problem->memory = s->create(BDF, NEWTON);
  if (!problem->x || !problem->memory) return -1;
  memset(s->values(problem->x), 0, problem->total * sizeof(double));
  if ((bad = s->handler(problem->memory, silent, 0))) return bad;
  if ((bad = s->init(problem->memory, right, t, problem->x))) return bad;
  if ((bad = s->tolerances(problem->memory, rtol, atol))) return bad;
  if ((bad = s->user_data(problem->memory, problem))) return bad;
  if ((bad = s->most_steps(problem->memory, most_steps))) return bad;
  if (longest > 0 && (bad = s->longest_step(problem->memory, longest))) return bad;
  if ((bad = s->gmres(problem->memory, LEFT, BASES))) return bad;
  if ((bad = s->preconditioner(problem->memory, setup, solve))) return bad;
  return s->jacobian_times(problem->memory, times);
}

void finish(Problem *problem) {
  if (problem->memory) problem->sundials->release(&problem->memory);
  if (problem->x) problem->sundials->drop(problem->x);
  problem->x = 0;
}

/* Begin a run at x (total,) with p (n_p,). */
int begin(Problem *problem, double t, const double *x, const double *p) {
  memcpy(problem->sundials->values(problem->x), x, problem->total * sizeof(double));
  memcpy(problem->right.slots + problem->right.n_constants + 1 + problem->total, p, problem->n_p * sizeof(double));
  memcpy(problem->slope.slots + problem->slope.n_constants + 1 + problem->total, p, problem->n_p * sizeof(double));
  problem->piece = 0;
  return problem->sundials->reinit(problem->memory, t, problem->x);
}

/* Go on to stops[1 ... number], from stops[0], where the run stands; `first` is the number of the interval that begins there.
   x (total, number) by columns. 0, or what CVODES answers, with the time reached in `reached`. */
int advance(Problem *problem, long number, const double *stops, long first, double *x, double *reached, long *counts) {
  const Sundials *s = problem->sundials;
  long k, more;
  int answer = 0;
  for (k = 0; k < number; ++k) {
    if (problem->restart) {
      problem->piece = first + k;
      if ((answer = s->reinit(problem->memory, stops[k], problem->x))) return answer;
      if ((answer = s->stop_time(problem->memory, stops[k + 1]))) return answer;
    }
    answer = s->step(problem->memory, stops[k + 1], problem->x, reached, NORMAL);
    if (problem->restart || k + 1 == number || answer < 0) { /* counts begin anew with each start */
      s->steps(problem->memory, &more), counts[0] = problem->restart ? counts[0] + more : more;
      s->evaluations(problem->memory, &more), counts[1] = problem->restart ? counts[1] + more : more;
      s->error_failures(problem->memory, &more), counts[2] = problem->restart ? counts[2] + more : more;
    }
    if (answer < 0) return answer;
    memcpy(x + k * problem->total, s->values(problem->x), problem->total * sizeof(double));
  }
  return 0;
}
