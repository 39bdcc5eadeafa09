/* Kalman filter and smoother for an unknown input at G places, sample by sample and channel by channel, as
   localise/kalman_smoother.py states them; all arrays by rows. Of each place the state (size = n + 1) holds the deviation of
   the machine and the input, in `columns` columns: at parameters 0, and per unit of each. */
#include <math.h>
#include <string.h>

typedef struct {
  long count, places, n, m, k, keeps;
  const double *phi;       /* (N-1, n, n+k): the transitions, and what the parameters add */
  const double *c;         /* (N, m, n+k): the rows of the channels, and what the parameters add */
  const double *gamma, *d; /* (N-1, G, n), (N, G, m): what the input of each place does to the states and to the channels */
  const double *moved, *error; /* (N-1, n, 1+k), (N, m, 1+k) */
  const double *growth;        /* (N-1, G): by how much the variance of the input grows in a step */
  double *x, *p;               /* (G, n+1, 1+k), (G, n+1, n+1): at the first sample; the last one at the end */
  double *constant, *squares;  /* (G,), (G, 1+k, 1+k) of the likelihood */
  /* what is kept of each sample: (N, G, n+1, 1+k), (N, G, n+1, n+1), (N, m, G, n+1) twice, (N, m, G, 1+k), (N, m, G) */
  double *all_x, *all_p, *rows, *gains, *wrong, *weight;
  double *states, *variance; /* (N, G, n+1, 1+k), (N, G), by the way back */
} System;

static const double TWO_PI = 6.283185307179586;

/* x and P of a place over step i: A x + u and A P A' + q g g', with A = [phi gamma; 0 1] and g = (gamma / 2, 1). */
static void predict(const System *s, long i, long g, double *x, double *p) {
  long n = s->n, size = n + 1, width = n + s->k, columns = 1 + s->k, a, b, j;
  const double *phi = s->phi + i * n * width, *gamma = s->gamma + (i * s->places + g) * n;
  const double *moved = s->moved + i * n * columns;
  double growth = s->growth[i * s->places + g], old_x[size * columns], half[size * size], act[size];
  memcpy(old_x, x, sizeof old_x);
  memset(half, 0, sizeof half);
  for (a = 0; a < n; ++a) {
    act[a] = gamma[a] / 2;
    for (b = 0; b < columns; ++b) x[a * columns + b] = moved[a * columns + b] + gamma[a] * old_x[n * columns + b];
    for (j = 0; j < n; ++j)
      for (b = 0; b < columns; ++b) x[a * columns + b] += phi[a * width + j] * old_x[j * columns + b];
    for (b = 0; b < size; ++b) half[a * size + b] = gamma[a] * p[n * size + b];
    for (j = 0; j < n; ++j)
      for (b = 0; b < size; ++b) half[a * size + b] += phi[a * width + j] * p[j * size + b];
  }
  act[n] = 1.0;
  memcpy(half + n * size, p + n * size, size * sizeof(double));
  for (a = 0; a < size; ++a)
    for (b = 0; b < size; ++b) {
      double sum = half[a * size + n] * (b < n ? gamma[b] : 1.0);
      for (j = 0; j < n && b < n; ++j) sum += half[a * size + j] * phi[b * width + j];
      p[a * size + b] = sum + growth * act[a] * act[b];
    }
}

/* x and P of a place after channel c of sample i, P as P. D. Joseph writes it. */
static void update(const System *s, long i, long c, long g, double *x, double *p) {
  long n = s->n, size = n + 1, columns = 1 + s->k, place = (i * s->m + c) * s->places + g, a, b;
  double row[size], towards[size], gain[size], wrong[columns], variance = 1.0, *squares = s->squares + g * columns * columns;
  memcpy(row, s->c + (i * s->m + c) * (n + s->k), n * sizeof(double));
  row[n] = s->d[(i * s->places + g) * s->m + c];
  memcpy(wrong, s->error + (i * s->m + c) * columns, sizeof wrong);
  for (a = 0; a < size; ++a) {
    towards[a] = 0.0;
    for (b = 0; b < size; ++b) towards[a] += p[a * size + b] * row[b];
    variance += row[a] * towards[a];
    for (b = 0; b < columns; ++b) wrong[b] -= row[a] * x[a * columns + b];
  }
  for (a = 0; a < size; ++a) gain[a] = towards[a] / variance;
  for (a = 0; a < size; ++a) {
    double *own = p + a * size, rest = gain[a];
    for (b = 0; b < columns; ++b) x[a * columns + b] += gain[a] * wrong[b];
    for (b = 0; b < size; ++b) own[b] -= gain[a] * towards[b];
    for (b = 0; b < size; ++b) rest -= own[b] * row[b];
    for (b = 0; b < size; ++b) own[b] += rest * gain[b];
  }
  s->constant[g] += log(TWO_PI * (variance > 0 ? variance : INFINITY));
  for (a = 0; a < columns; ++a)
    for (b = 0; b < columns; ++b) squares[a * columns + b] += wrong[a] / variance * wrong[b];
  if (!s->keeps) return;
  memcpy(s->rows + place * size, row, sizeof row);
  memcpy(s->gains + place * size, gain, sizeof gain);
  for (b = 0; b < columns; ++b) s->wrong[place * columns + b] = wrong[b] / variance;
  s->weight[place] = 1 / variance;
}

/* Forwards: the likelihood of each place, and what is kept of each sample. */
void filter(const System *s) {
  long size = s->n + 1, columns = 1 + s->k, i, c, g;
  for (g = 0; g < s->places; ++g) {
    double *x = s->x + g * size * columns, *p = s->p + g * size * size;
    for (i = 0; i < s->count; ++i) {
      if (i) predict(s, i - 1, g, x, p);
      for (c = 0; c < s->m; ++c) update(s, i, c, g, x, p);
      if (!s->keeps) continue;
      memcpy(s->all_x + (i * s->places + g) * size * columns, x, size * columns * sizeof(double));
      memcpy(s->all_p + (i * s->places + g) * size * size, p, size * size * sizeof(double));
    }
  }
}

/* The adjoint and the information of a place before channel c of sample i, from those behind it. */
static void take_back(const System *s, long i, long c, long g, double *adjoint, double *information) {
  long size = s->n + 1, columns = 1 + s->k, place = (i * s->m + c) * s->places + g, a, b;
  const double *row = s->rows + place * size, *gain = s->gains + place * size, *wrong = s->wrong + place * columns;
  double through[columns], turned[size], sum = s->weight[place];
  memcpy(through, wrong, sizeof through);
  for (a = 0; a < size; ++a) {
    turned[a] = 0.0;
    for (b = 0; b < columns; ++b) through[b] += gain[a] * adjoint[a * columns + b];
    for (b = 0; b < size; ++b) turned[a] += information[a * size + b] * gain[b];
    sum += gain[a] * turned[a];
  }
  for (a = 0; a < size; ++a) {
    for (b = 0; b < columns; ++b) adjoint[a * columns + b] -= row[a] * through[b];
    for (b = 0; b < size; ++b)
      information[a * size + b] += sum * (row[a] * row[b]) - row[a] * turned[b] - turned[a] * row[b];
  }
}

/* The same before step i: A' y and A' L A. */
static void step_back(const System *s, long i, long g, double *adjoint, double *information) {
  long n = s->n, size = n + 1, width = n + s->k, columns = 1 + s->k, a, b, j;
  const double *phi = s->phi + i * n * width, *gamma = s->gamma + (i * s->places + g) * n;
  double old[size * columns], half[size * size], act[size * size];
  for (a = 0; a < size; ++a)
    for (b = 0; b < size; ++b)
      act[a * size + b] = a == n ? (b == n ? 1.0 : 0.0) : b == n ? gamma[a] : phi[a * width + b];
  memcpy(old, adjoint, sizeof old);
  memset(adjoint, 0, sizeof old);
  memset(half, 0, sizeof half);
  for (j = 0; j < size; ++j)
    for (a = 0; a < size; ++a) {
      for (b = 0; b < columns; ++b) adjoint[a * columns + b] += act[j * size + a] * old[j * columns + b];
      for (b = 0; b < size; ++b) half[a * size + b] += act[j * size + a] * information[j * size + b];
    }
  memset(information, 0, size * size * sizeof(double));
  for (a = 0; a < size; ++a)
    for (j = 0; j < size; ++j)
      for (b = 0; b < size; ++b) information[a * size + b] += half[a * size + j] * act[j * size + b];
}

/* Back through what was kept: the best estimate of the states, and the variance of the input. */
void smooth(const System *s) {
  long n = s->n, size = n + 1, columns = 1 + s->k, i, c, g, a, b, j;
  for (g = 0; g < s->places; ++g) {
    double adjoint[size * columns], information[size * size];
    memset(adjoint, 0, sizeof adjoint);
    memset(information, 0, sizeof information);
    for (i = s->count - 1; i >= 0; --i) {
      const double *p = s->all_p + (i * s->places + g) * size * size, *last = p + n * size;
      const double *x = s->all_x + (i * s->places + g) * size * columns;
      double *states = s->states + (i * s->places + g) * size * columns, variance = last[n];
      for (a = 0; a < size; ++a)
        for (b = 0; b < columns; ++b) {
          double sum = x[a * columns + b];
          for (j = 0; j < size; ++j) sum -= p[a * size + j] * adjoint[j * columns + b];
          states[a * columns + b] = sum;
        }
      for (a = 0; a < size; ++a)
        for (b = 0; b < size; ++b) variance -= last[a] * information[a * size + b] * last[b];
      s->variance[i * s->places + g] = variance;
      for (c = s->m - 1; c >= 0; --c) take_back(s, i, c, g, adjoint, information);
      if (i) step_back(s, i - 1, g, adjoint, information);
    }
  }
}

/* What a whitened filter makes of inputs (see localise/whitening.py): from rest, [v; x'] = map [x; input; mean] sample by
   sample, with maps (N, m+n, n+2), inputs (N, width), means (N-1, width) over the steps, v (N, m, width); `work` has room for
   2 n width numbers. */
void respond(long count, long m, long n, long width, const double *maps, const double *inputs, const double *means, double *v,
             double *work) {
  double *x = work, *next = work + n * width;
  long i, a, j, b;
  memset(work, 0, 2 * n * width * sizeof(double));
  for (i = 0; i < count; ++i) {
    const double *input = inputs + i * width, *mean = means + (i < count - 1 ? i : count - 2) * width;
    for (a = 0; a < m + n; ++a) {
      const double *row = maps + (i * (m + n) + a) * (n + 2);
      double *made = a < m ? v + (i * m + a) * width : next + (a - m) * width;
      for (b = 0; b < width; ++b) made[b] = row[n] * input[b] + row[n + 1] * mean[b];
      for (j = 0; j < n; ++j)
        for (b = 0; b < width; ++b) made[b] += row[j] * x[j * width + b];
    }
    double *other = x;
    x = next;
    next = other;
  }
}
