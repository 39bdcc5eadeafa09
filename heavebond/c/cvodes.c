/* x' = f(t, x, z, p, u), 0 = g(t, x, z, p, u) integrated by the CVODES that CasADi brings, with forward sensitivities and
   signals s(t, x, z, p, u), from the first to the last stop in one call.

   CVODES (BDF of variable order, Newton's method; A. C. Hindmarsh et al., 2005, doi:10.1145/1089014.1089020) is called by
   the addresses of its functions. f, g, s and their derivatives are lists of operations in static single assignment form
   over an array of slots: constants, then t, x, z, p and u, then results. Behind the n states of the model stand m blocks of
   their sensitivities along directions dp of the parameters,

       X' = f_x X + f_z Z + f_p dp,      0 = g_x X + g_z Z + g_p dp,

   whose products are formed here from the nonzeros of one Jacobian, so that no list grows with m. z follows from x by
   Newton's method at each evaluation. The Jacobian of the states is that of every block, so that each linear system is
   solved block by block with one factorisation. */
#include <malloc.h>
#include <math.h>
#include <stddef.h>
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
  int (*between)(void *, double, int, N_Vector);
  int (*steps)(void *, long *);
  int (*evaluations)(void *, long *);
  int (*error_failures)(void *, long *);
  void (*release)(void **);
  N_Vector (*vector)(long);
  double *(*values)(N_Vector);
  void (*drop)(N_Vector);
} Sundials;

/* What CVODES keeps in its memory from the coefficient of the Newton matrix to the linear solver. */
typedef struct {
  double gamma, others[9];
  int iterations;
  long *failures;
  int highest_order;
  long most_steps;
  int limits[5];
  double step_limits[3];
  long counts[19];
  int warnings;
  long sizes[6];
  double ratios[3];
  int (*init)(void *);
  int (*setup)(void *, int, N_Vector, N_Vector, int *, N_Vector, N_Vector, N_Vector);
  int (*solve)(void *, N_Vector, N_Vector, N_Vector, N_Vector);
  void (*release)(void *);
  void *own;
} Newton;

/* A function: `code` holds (operation, result, operand, operand) of each operation; `out` the slots of the outputs. Where
   it is compiled there are no constants, and the outputs follow the inputs from slot `first` on. */
typedef struct {
  long length, n_out, n_constants;
  const int *code, *out;
  double *slots;
  int (*compiled)(const double **, double **, long long *, double *, int);
  long first;
} Tape;

/* A Jacobian with the columns (x, z, moving parameters): nonzero k stands in rows[k], columns[k]; the values follow those of
   the function itself in its list. */
typedef struct {
  long nonzeros;
  const int *rows, *columns;
} Pattern;

struct Sampled;

typedef struct {
  const Sundials *sundials;
  Tape right, full, signals, looked; /* f; f and g with their Jacobian; s with its Jacobian; see first_limit */
  Pattern slopes, signal_slopes;
  long n, n_z, m, total, n_moving, n_p, n_u, n_signals, n_pieces, restart, n_kinks; /* restart: integration stops at each break */
  const double *breaks, *pieces; /* (n_pieces + 1,), (n_u, n_pieces) by columns */
  const double *at_stops;        /* (n_u, N) by columns: what drives the model at each stop */
  const double *kinks;           /* (n_kinks,): stops at which the integration begins anew */
  const double *directions;      /* (n_moving, m) by columns */
  long piece, kink, noted[3];    /* kink: the next one; noted: counts of CVODES at the last look */
  double *z, *along;             /* (n_z,), (n_z, m) by columns */
  double *jacobian, *lu, *inverse;
  int *pivots;
  double *loop, *loop_inverse, *by_x; /* g_z factored, and g_z^-1 g_x (n_z, n) by columns */
  int *loop_pivots;
  void *memory;
  N_Vector x;
  Newton *newton; /* null where GMRES solves */
  double factored; /* gamma of the factorisation */
  double *stages;  /* (8, total), of the one-step method */
  long one_step, most_steps, most_evaluations;
  double rtol, atol, longest, step;
  /* Outputs of `looked` from `first_limit` on, behind the indicators of conditions: how far variables are above their physical
     limits. A run ends at an accepted step where one is below by more than its grace; `least` of each, with its time, and
     `most` are noted (3, n_limits) by rows. */
  long n_limits, first_limit;
  const double *grace;
  double *margins, end, at; /* of the run; of the last accepted step of CVODES */
  struct Sampled *sampled; /* null in a run without samples */
} Problem;

/* The problem that this thread integrates: a linear solver of CVODES is given nothing of it. */
static _Thread_local Problem *integrating;

enum { BDF = 2, NEWTON = 2, NORMAL = 1, LEFT = 1, BASES = 5, HIGHEST_ORDER = 5, RIGHT_FAILED = -8, LIMIT_PASSED = -103,
       NEWTON_STEPS = 20, ONE_STEP = 2 };

/* Newton's method for z ends with a step of less than this share of 1 + |z| (in scaled unknowns); z is not determined where
   a pivot of g_z is less than this share of its largest entry. */
static const double SETTLED = 1e-10, SINGULAR = 1e-13, NEVER = 1e300;

/* Each operation jumps to the next by itself, which a processor predicts better than one switch for all; LABELS and
   OPERATIONS are made of one table in Python, whose last operation ends the list. */
static void evaluate(const Tape *tape) {
  static const void *const labels[] = {LABELS};
  double *const w = tape->slots;
  const int *c = tape->code;
  if (tape->compiled) {
    const double *given = w;
    double *found = w + tape->first;
    tape->compiled(&given, &found, 0, 0, 0);
    return;
  }
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

/* Put t, x, z and what drives the model into the slots of a function; p stands there since the run began. */
static void bind(Problem *problem, Tape *tape, double t, const double *x, const double *u) {
  double *w = tape->slots + tape->n_constants;
  *w++ = t;
  memcpy(w, x, problem->n * sizeof(double));
  if (problem->n_z) memcpy(w + problem->n, problem->z, problem->n_z * sizeof(double));
  if (problem->n_u) memcpy(w + problem->n + problem->n_z + problem->n_p, u, problem->n_u * sizeof(double));
}

/* The piece of the inputs that holds at t. */
static const double *driving(Problem *problem, double t) {
  const double *breaks = problem->breaks;
  long k = problem->piece;
  if (!problem->n_u) return 0;
  if (!problem->restart) {
    while (k + 1 < problem->n_pieces && t >= breaks[k + 1]) ++k;
    while (k > 0 && t < breaks[k]) --k;
    problem->piece = k;
  }
  return problem->pieces + k * problem->n_u;
}

/* P A = L U in place, by rows; 1 where a pivot is no larger than `least` times the largest entry. */
static int factor(double *a, long n, int *pivots, double *inverse, double least) {
  double largest = 0.0;
  long i, j, k;
  for (k = 0; k < n * n && least > 0; ++k) largest = fmax(largest, fabs(a[k]));
  for (k = 0; k < n; ++k) {
    long best = k;
    for (i = k + 1; i < n; ++i)
      if (fabs(a[i * n + k]) > fabs(a[best * n + k])) best = i;
    if (!(fabs(a[best * n + k]) > least * largest)) return 1;
    pivots[k] = (int)best;
    for (j = 0; j < n && best != k; ++j) {
      double kept = a[k * n + j];
      a[k * n + j] = a[best * n + j];
      a[best * n + j] = kept;
    }
    for (i = k + 1; i < n; ++i) {
      double factor = a[i * n + k] /= a[k * n + k];
      if (factor != 0.0)
        for (j = k + 1; j < n; ++j) a[i * n + j] -= factor * a[k * n + j];
    }
    inverse[k] = 1.0 / a[k * n + k];
  }
  return 0;
}

static void substitute(const double *lu, long n, const int *pivots, const double *inverse, double *z) {
  long i, j;
  for (i = 0; i < n; ++i) {
    double kept = z[pivots[i]];
    z[pivots[i]] = z[i];
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
    z[i] = left * inverse[i];
  }
}

/* The same for `blocks` right sides, one behind the other in z: the operations of each are those of `substitute`, in the same
   order, but side by side, as each waits for the one before it. */
static void substitute_all(const double *lu, long n, const int *pivots, const double *inverse, double *z, long blocks) {
  double side[n * blocks];
  long i, j, b;
  for (b = 0; b < blocks; ++b)
    for (i = 0; i < n; ++i) side[i * blocks + b] = z[b * n + i];
  for (i = 0; i < n; ++i) {
    double *one = side + pivots[i] * blocks, *other = side + i * blocks;
    for (b = 0; b < blocks && one != other; ++b) {
      double kept = one[b];
      one[b] = other[b];
      other[b] = kept;
    }
  }
  for (i = 1; i < n; ++i)
    for (j = 0; j < i; ++j)
      for (b = 0; b < blocks; ++b) side[i * blocks + b] -= lu[i * n + j] * side[j * blocks + b];
  for (i = n - 1; i >= 0; --i) {
    for (j = i + 1; j < n; ++j)
      for (b = 0; b < blocks; ++b) side[i * blocks + b] -= lu[i * n + j] * side[j * blocks + b];
    for (b = 0; b < blocks; ++b) side[i * blocks + b] *= inverse[i];
  }
  for (b = 0; b < blocks; ++b)
    for (i = 0; i < n; ++i) z[b * n + i] = side[i * blocks + b];
}

#define VALUE(tape, k) (tape)->slots[(tape)->out[k]]

/* f, g and their Jacobian at t and x, with z found so that g = 0 and g_z factored; 1 where that fails. */
static int complete(Problem *problem, double t, const double *x, const double *u) {
  Tape *tape = &problem->full;
  const Pattern *at = &problem->slopes;
  long n = problem->n, n_z = problem->n_z, i, k, tries;
  double change[n_z + 1];
  for (tries = 0; tries < NEWTON_STEPS; ++tries) {
    double largest = 0.0;
    bind(problem, tape, t, x, u);
    evaluate(tape);
    if (!n_z) return 0;
    memset(problem->loop, 0, n_z * n_z * sizeof(double));
    for (k = 0; k < at->nonzeros; ++k)
      if (at->rows[k] >= n && at->columns[k] >= n && at->columns[k] < n + n_z)
        problem->loop[(at->rows[k] - n) * n_z + at->columns[k] - n] = VALUE(tape, n + n_z + k);
    for (i = 0; i < n_z; ++i) change[i] = VALUE(tape, n + i);
    if (factor(problem->loop, n_z, problem->loop_pivots, problem->loop_inverse, SINGULAR)) return 1;
    substitute(problem->loop, n_z, problem->loop_pivots, problem->loop_inverse, change);
    for (i = 0; i < n_z; ++i) {
      double share = fabs(change[i]) / (1.0 + fabs(problem->z[i]));
      if (!(share < HUGE_VAL)) return 1;
      if (share > largest) largest = share;
      problem->z[i] -= change[i];
    }
    if (largest <= SETTLED) return 0;
  }
  return 1;
}

/* Z (n_z, m) from X: g_z Z = -(g_x X + g_p dp). */
static void follow(Problem *problem, const double *x) {
  const Tape *tape = &problem->full;
  const Pattern *at = &problem->slopes;
  long n = problem->n, n_z = problem->n_z, j, k;
  memset(problem->along, 0, n_z * problem->m * sizeof(double));
  for (j = 0; j < problem->m; ++j) {
    const double *moved = x + (j + 1) * n, *dp = problem->directions + j * problem->n_moving;
    double *along = problem->along + j * n_z;
    for (k = 0; k < at->nonzeros; ++k) {
      long row = at->rows[k], column = at->columns[k];
      if (row >= n && (column < n || column >= n + n_z))
        along[row - n] -= VALUE(tape, n + n_z + k) * (column < n ? moved[column] : dp[column - n - n_z]);
    }
    substitute(problem->loop, n_z, problem->loop_pivots, problem->loop_inverse, along);
  }
}

/* Add the products of a Jacobian, whose values begin at output `first` of a function, with the moves of (x, z, p) along each
   direction to `moved` (end, m) by columns; rows from `end` on are left out. */
static void multiply(const Problem *problem, const Tape *tape, const Pattern *at, long first, long end, const double *x,
                     double *moved) {
  long n = problem->n, n_z = problem->n_z, m = problem->m, j, k;
  for (k = 0; k < at->nonzeros; ++k) {
    long row = at->rows[k], column = at->columns[k];
    const double *by = column < n         ? x + n + column
                       : column < n + n_z ? problem->along + column - n
                                          : problem->directions + column - n - n_z;
    long stride = column < n ? n : column < n + n_z ? n_z : problem->n_moving;
    double value;
    if (row >= end) continue;
    value = VALUE(tape, first + k);
    for (j = 0; j < m; ++j) moved[j * end + row] += value * by[j * stride];
  }
}

/* X' (total,) at t and X; 1 where it cannot be evaluated. */
static int rates(Problem *problem, double t, const double *x, double *out) {
  const double *u = driving(problem, t);
  long n = problem->n, k;
  Tape *tape = problem->m || problem->n_z ? &problem->full : &problem->right;
  if (tape == &problem->full) {
    if (complete(problem, t, x, u)) return 1;
  } else {
    bind(problem, tape, t, x, u);
    evaluate(tape);
  }
  for (k = 0; k < n; ++k) out[k] = VALUE(tape, k);
  if (problem->m) {
    memset(out + n, 0, (problem->total - n) * sizeof(double));
    if (problem->n_z) follow(problem, x);
    multiply(problem, tape, &problem->slopes, n + problem->n_z, n, x, out + n);
  }
  for (k = 0; k < problem->total; ++k)
    if (!isfinite(out[k])) return 1;
  return 0;
}

static int right(double t, N_Vector given, N_Vector found, void *data) {
  Problem *problem = data;
  return rates(problem, t, problem->sundials->values(given), problem->sundials->values(found));
}

/* Test the physical limits at an accepted step; LIMIT_PASSED where a variable is below its limit. */
static int within(Problem *problem, double t, const double *x) {
  const double *u = driving(problem, t);
  long n = problem->n_limits, k;
  double *least = problem->margins, *when = least + n, *most = when + n;
  if (!n || (problem->n_z && complete(problem, t, x, u))) return 0;
  bind(problem, &problem->looked, t, x, u);
  evaluate(&problem->looked);
  for (k = 0; k < n; ++k) {
    double above = VALUE(&problem->looked, problem->first_limit + k);
    if (above < least[k]) least[k] = above, when[k] = t;
    if (above > most[k]) most[k] = above;
    if (above < -problem->grace[k]) return LIMIT_PASSED;
  }
  return 0;
}

static int passed(Problem *problem, double t, double step, const double *x, const double *next, double *const *k);

#include "dormand_prince.c"

/* I - gamma J = P' L U. */
static int factor_newton(Problem *problem, double gamma) {
  long n = problem->n, k;
  double *lu = problem->lu;
  for (k = 0; k < n * n; ++k) lu[k] = -gamma * problem->jacobian[k];
  for (k = 0; k < n; ++k) lu[k * n + k] += 1.0;
  problem->factored = gamma;
  return factor(lu, n, problem->pivots, problem->inverse, 0.0);
}

/* The Jacobian at a point, f_x - f_z g_z^-1 g_x, and I - gamma J = P' L U. */
static int setup(double t, N_Vector given, N_Vector rates, int known, int *renewed, double gamma, void *data, N_Vector a,
                 N_Vector b, N_Vector c) {
  Problem *problem = data;
  const Tape *tape = &problem->full;
  const Pattern *at = &problem->slopes;
  long n = problem->n, n_z = problem->n_z, j, k;
  if (problem->newton && problem->newton->gamma != gamma) return -1; /* then it is not where it was taken to be */
  *renewed = !known;
  if (!known) {
    if (complete(problem, t, problem->sundials->values(given), driving(problem, t))) return 1;
    memset(problem->jacobian, 0, n * n * sizeof(double));
    if (n_z) memset(problem->by_x, 0, n_z * n * sizeof(double));
    for (k = 0; k < at->nonzeros; ++k) {
      if (at->columns[k] >= n) continue;
      if (at->rows[k] < n)
        problem->jacobian[at->rows[k] * n + at->columns[k]] = VALUE(tape, n + n_z + k);
      else
        problem->by_x[at->columns[k] * n_z + at->rows[k] - n] = VALUE(tape, n + n_z + k);
    }
    for (j = 0; j < n && n_z; ++j)
      substitute(problem->loop, n_z, problem->loop_pivots, problem->loop_inverse, problem->by_x + j * n_z);
    for (k = 0; k < at->nonzeros && n_z; ++k)
      if (at->rows[k] < n && at->columns[k] >= n && at->columns[k] < n + n_z)
        for (j = 0; j < n; ++j)
          problem->jacobian[at->rows[k] * n + j] -=
              VALUE(tape, n + n_z + k) * problem->by_x[j * n_z + at->columns[k] - n];
  }
  return factor_newton(problem, gamma);
}

/* z = (I - gamma J)^-1 z for each block. */
static void solve_blocks(Problem *problem, double *z) {
  if (problem->m)
    substitute_all(problem->lu, problem->n, problem->pivots, problem->inverse, z, 1 + problem->m);
  else
    substitute(problem->lu, problem->n, problem->pivots, problem->inverse, z);
}

static int precondition(double t, N_Vector x, N_Vector rates, N_Vector given, N_Vector found, double gamma, double delta,
                        int side, void *data, N_Vector a) {
  Problem *problem = data;
  double *z = problem->sundials->values(found);
  memcpy(z, problem->sundials->values(given), problem->total * sizeof(double));
  solve_blocks(problem, z);
  return 0;
}

static int times(N_Vector given, N_Vector found, double t, N_Vector x, N_Vector rates, void *data, N_Vector a) {
  Problem *problem = data;
  long n = problem->n, blocks = 1 + problem->m, block, i, j;
  const double *v = problem->sundials->values(given);
  double *z = problem->sundials->values(found), side[blocks];
  for (i = 0; i < n; ++i) {
    const double *row = problem->jacobian + i * n;
    for (block = 0; block < blocks; ++block) side[block] = 0.0;
    for (j = 0; j < n; ++j)
      for (block = 0; block < blocks; ++block) side[block] += row[j] * v[block * n + j];
    for (block = 0; block < blocks; ++block) z[block * n + i] = side[block];
  }
  return 0;
}

/* The direct solver in place of GMRES: one substitution for each of Newton's steps. Between two factorisations gamma moves by
   less than a third; the step is scaled for that, as the direct solvers of CVODES do. */
static int solve(void *memory, N_Vector b, N_Vector weight, N_Vector x, N_Vector rates) {
  Problem *problem = integrating;
  double *z = problem->sundials->values(b), gamma = problem->newton->gamma;
  if (gamma != problem->factored) {
    if (problem->n <= 3 * (1 + problem->m)) { /* then it takes no more than the substitution */
      if (factor_newton(problem, gamma)) return 1;
    } else {
      double share = 2.0 / (1.0 + gamma / problem->factored);
      long k;
      for (k = 0; k < problem->total; ++k) z[k] *= share;
    }
  }
  solve_blocks(problem, z);
  return 0;
}

/* Put `solve` in place of GMRES, which was attached to a memory that held `before` until then. Its five entries are all that
   has changed since; where there are others, or what stands before them is not as it was set, GMRES stays. */
static void solve_directly(Problem *problem, void *const *before, long size, long most_steps) {
  void **now = problem->memory;
  long k, first = -1, number = 0;
  Newton *newton;
  for (k = 0; k < size; ++k)
    if (now[k] != before[k]) {
      if (first < 0) first = k;
      ++number;
    }
  if (number != 5 || first * (long)sizeof(void *) < (long)offsetof(Newton, init)) return;
  newton = (Newton *)((char *)(now + first) - offsetof(Newton, init));
  for (k = 0; k < 5; ++k)
    if (before[first + k] || !now[first + k]) return;
  if (newton->most_steps != most_steps || newton->highest_order != HIGHEST_ORDER || newton->gamma != 0) return;
  newton->solve = solve;
  problem->newton = newton;
}

static void silent(int code, const char *module, const char *function, char *message, void *data) {}

/* Prepare a problem, with the direct solver if it is permitted and can be attached; 0, or what CVODES answers. */
int prepare(Problem *problem, double t, double rtol, double atol, long most_steps, double longest, int direct) {
  const Sundials *s = problem->sundials;
  int bad = 0;
  long size;
  problem->rtol = rtol, problem->atol = atol, problem->most_steps = most_steps, problem->longest = longest;
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
  size = malloc_usable_size(problem->memory) / sizeof(void *);
  {
    void *before[size];
    memcpy(before, problem->memory, size * sizeof(void *));
    if ((bad = s->gmres(problem->memory, LEFT, BASES))) return bad;
    if (direct) solve_directly(problem, before, size, most_steps);
  }
  if ((bad = s->preconditioner(problem->memory, setup, precondition))) return bad;
  return s->jacobian_times(problem->memory, times);
}

/* Make steps no longer than this from now on; 0 for no limit. */
int limit(Problem *problem, double longest) {
  problem->longest = longest;
  return problem->sundials->longest_step(problem->memory, longest);
}

/* The states at which the last run ended (total,). */
double *state(Problem *problem) { return problem->sundials->values(problem->x); }

void finish(Problem *problem) {
  if (problem->memory) problem->sundials->release(&problem->memory);
  if (problem->x) problem->sundials->drop(problem->x);
  problem->x = 0;
}

/* Write what is wanted of stop k: x (total, N), z and Z (n_z (1 + m), N), signals and their moves (n_signals (1 + m), N), all
   by columns, each where it is not null; 1 where it cannot be evaluated. */
static int note(Problem *problem, long k, double t, double *x_out, double *z_out, double *signals) {
  const double *x = problem->sundials->values(problem->x), *u = problem->at_stops + k * problem->n_u;
  long n_z = problem->n_z, n_signals = problem->n_signals, m = problem->m, i;
  if (x_out) memcpy(x_out + k * problem->total, x, problem->total * sizeof(double));
  if (n_z) {
    if (complete(problem, t, x, u)) return RIGHT_FAILED;
    if (m) follow(problem, x);
    if (z_out) {
      memcpy(z_out + k * n_z * (1 + m), problem->z, n_z * sizeof(double));
      memcpy(z_out + k * n_z * (1 + m) + n_z, problem->along, n_z * m * sizeof(double));
    }
  }
  if (signals) {
    double *out = signals + k * n_signals * (1 + m);
    bind(problem, &problem->signals, t, x, u);
    evaluate(&problem->signals);
    for (i = 0; i < n_signals; ++i) out[i] = VALUE(&problem->signals, i);
    memset(out + n_signals, 0, n_signals * m * sizeof(double));
    multiply(problem, &problem->signals, &problem->signal_slopes, n_signals, n_signals, x, out + n_signals);
  }
  return 0;
}

static void put(Problem *problem, Tape *tape, const double *p) {
  if (tape->slots)
    memcpy(tape->slots + tape->n_constants + 1 + problem->n + problem->n_z, p, problem->n_p * sizeof(double));
}

/* Begin a run at x (total,) with z near (n_z,) and p (n_p,), and write what is wanted of its first stop. */
int begin(Problem *problem, double t, const double *x, const double *z, const double *p, double *x_out, double *z_out,
          double *signals) {
  long k;
  int bad;
  memcpy(problem->sundials->values(problem->x), x, problem->total * sizeof(double));
  if (problem->n_z) memcpy(problem->z, z, problem->n_z * sizeof(double));
  put(problem, &problem->right, p);
  put(problem, &problem->full, p);
  put(problem, &problem->signals, p);
  put(problem, &problem->looked, p);
  for (k = 0; k < problem->n_limits; ++k)
    problem->margins[k] = HUGE_VAL, problem->margins[2 * problem->n_limits + k] = -HUGE_VAL;
  problem->at = t;
  problem->piece = problem->kink = 0;
  memset(problem->noted, 0, sizeof problem->noted);
  problem->step = 0.0;
  bad = note(problem, 0, t, x_out, z_out, signals);
  return bad ? bad : problem->sundials->reinit(problem->memory, t, problem->x);
}

/* Step by CVODES to a stop, the last one of the run if it is no less than `last`, and test the limits at each step before the
   end of the run and at this. */
static int limited_steps(Problem *problem, double stop, double last, double *reached) {
  const Sundials *s = problem->sundials;
  double *x = s->values(problem->x);
  long number;
  int answer;
  for (number = 0; problem->at < stop; ++number) {
    if (number >= problem->most_steps) return *reached = problem->at, TOO_MANY_STEPS;
    if ((answer = s->step(problem->memory, stop, problem->x, reached, ONE_STEP)) < 0) return answer;
    problem->at = *reached;
    if (problem->at < last && (answer = within(problem, problem->at, x))) return answer;
  }
  if (problem->at > stop && (answer = s->between(problem->memory, stop, 0, problem->x))) return answer;
  *reached = stop;
  return stop < last ? 0 : within(problem, stop, x);
}

/* Go on to stops[1 ... number], from stops[0], where the run stands; `first` is the number of the interval that begins there.
   By the one-step method where that is asked for. 0, or what CVODES answers, with the time reached in `reached`. */
int advance(Problem *problem, long number, const double *stops, long first, double *x_out, double *z_out, double *signals,
            double *reached, long *counts) {
  const Sundials *s = problem->sundials;
  long k, at_kink;
  int answer = 0;
  integrating = problem;
  for (k = 0; k < number; ++k) {
    for (at_kink = 0; problem->kink < problem->n_kinks && problem->kinks[problem->kink] <= stops[k]; ++problem->kink) at_kink = 1;
    if (problem->one_step) {
      if (problem->restart) problem->piece = first + k;
      if (!(problem->step > 0)) problem->step = stops[k + 1] - stops[k];
      answer = explicit_steps(problem, stops[k], stops[k + 1], !problem->restart && !at_kink && (first || k), reached,
                              counts);
      if (answer || (answer = note(problem, first + k + 1, stops[k + 1], x_out, z_out, signals))) return answer;
      continue;
    }
    if (problem->restart) {
      problem->piece = first + k;
      if ((answer = s->reinit(problem->memory, stops[k], problem->x))) return answer;
      if ((answer = s->stop_time(problem->memory, stops[k + 1]))) return answer;
    } else if (problem->n_kinks) {
      if (at_kink && (answer = s->reinit(problem->memory, stops[k], problem->x))) return answer;
      if ((answer = s->stop_time(problem->memory, problem->kink < problem->n_kinks ? problem->kinks[problem->kink] : NEVER)))
        return answer;
    }
    if (problem->restart || at_kink) problem->at = stops[k];
    answer = problem->n_limits ? limited_steps(problem, stops[k + 1], problem->end, reached)
                               : s->step(problem->memory, stops[k + 1], problem->x, reached, NORMAL);
    if (problem->restart || k + 1 == number || answer < 0 || problem->n_kinks) {
      /* counts begin anew with each start */
      long *noted = problem->noted, anew = problem->restart || at_kink, now[3], i;
      s->steps(problem->memory, &now[0]), s->evaluations(problem->memory, &now[1]);
      s->error_failures(problem->memory, &now[2]);
      for (i = 0; i < 3; ++i) counts[i] += now[i] - (anew ? 0 : noted[i]), noted[i] = now[i];
    }
    if (answer < 0) return answer;
    if ((answer = note(problem, first + k + 1, stops[k + 1], x_out, z_out, signals))) return answer;
  }
  return 0;
}

#include "sampled.c"
