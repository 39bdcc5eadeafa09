/* A runner of MODEL.c for POSIX, written by heavebond; rename it before you change it. It makes one step of the
   program in each period of CLOCK_MONOTONIC, measures the time of each step, and exchanges inputs and outputs by UDP on the
   loopback interface.

     cc -std=c99 -O2 MODEL.c MODEL_runner.c -o MODEL -lm
     ./MODEL --help

   A datagram consists of doubles of 8 bytes, little-endian: the time in s, then the values in the order of MODEL.h.
     to --port (received)  time, inputs:  8 * (1 + MODEL_n_u) bytes; the inputs are held until the next datagram
     to --to (sent)        time, outputs: 8 * (1 + MODEL_n_y) bytes, or the outputs of --outputs
   Without --lock-step the time of a received datagram is not read. A datagram of another length, or with a value that is
   infinite or not a number, is rejected and counted. */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <netinet/in.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "MODEL.h"

enum { BINS_IN_OCTAVE = 16, OCTAVES = 40, BINS = BINS_IN_OCTAVE * OCTAVES, MOST_READ = 16, PATIENCE = 100, TRIES = 100 };

static volatile sig_atomic_t interrupted = 0;
static uint64_t histogram[BINS]; /* of step times: bin k begins at 2^(k / 16) ns */
static unsigned char received[8 * (2 + MODEL_n_u)], sent[8 * (1 + MODEL_n_y)];
static int chosen[MODEL_n_y + 1], n_chosen = MODEL_n_y; /* the outputs that are sent */
static unsigned long n_sent, n_received, n_rejected;

static void interrupt(int signal_number) {
  (void)signal_number;
  interrupted = 1;
}

static double clock_time(clockid_t clock) {
  struct timespec now;
  clock_gettime(clock, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void wait_until(double time) {
  struct timespec until;
  until.tv_sec = (time_t)time;
  until.tv_nsec = (long)(1e9 * (time - (double)until.tv_sec));
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) == EINTR && !interrupted) continue;
}

static void put_double(unsigned char *bytes, double value) {
  uint64_t bits;
  int k;
  memcpy(&bits, &value, 8);
  for (k = 0; k < 8; ++k) bytes[k] = (unsigned char)(bits >> (8 * k));
}

static double get_double(const unsigned char *bytes) {
  uint64_t bits = 0;
  double value;
  int k;
  for (k = 0; k < 8; ++k) bits |= (uint64_t)bytes[k] << (8 * k);
  memcpy(&value, &bits, 8);
  return value;
}

static void send_outputs(int udp, const struct sockaddr_in *to, const MODEL_run *run) {
  size_t size = 8 * (1 + (size_t)n_chosen);
  int k;
  put_double(sent, MODEL_time(run));
  for (k = 0; k < n_chosen; ++k) put_double(sent + 8 * (1 + k), MODEL_get_output(run, chosen[k]));
  if (sendto(udp, sent, size, 0, (const struct sockaddr *)to, sizeof *to) == (ssize_t)size) ++n_sent;
}

/* Read one datagram, if there is any, and set the inputs: 1 if it was accepted, 0 if not, -1 if there is none. In lock step
   the time must be later than *after. */
static int read_inputs(int udp, MODEL_run *run, double *after) {
  ssize_t size = recv(udp, received, sizeof received, 0);
  double time, value[MODEL_n_u + 1];
  int k, accepted;
  if (size < 0) return errno == ECONNREFUSED ? 0 : -1;
  accepted = size == 8 * (1 + MODEL_n_u);
  time = get_double(received);
  for (k = 0; k < MODEL_n_u && accepted; ++k) {
    value[k] = get_double(received + 8 * (1 + k));
    accepted = isfinite(value[k]);
  }
  if (!accepted) {
    ++n_rejected;
    return 0;
  }
  if (after && !(time > *after)) return 0; /* sent again */
  if (after) *after = time;
  for (k = 0; k < MODEL_n_u; ++k) MODEL_set_input(run, k, value[k]);
  ++n_received;
  return 1;
}

/* The upper limit in s of the bin that contains the quantile `share`. */
static double quantile(double share, uint64_t n) {
  uint64_t sum = 0;
  int k;
  for (k = 0; k < BINS; ++k)
    if ((double)(sum += histogram[k]) >= share * (double)n) break;
  return 1e-9 * pow(2, (k + 1.0) / BINS_IN_OCTAVE);
}

/* Choose the outputs of a list of names, separated by commas; the first unknown name, or NULL. */
static const char *choose_outputs(const char *list) {
  static char name[200];
  n_chosen = 0;
  for (;;) {
    size_t length = strcspn(list, ",");
    snprintf(name, sizeof name, "%.*s", (int)(length < 199 ? length : 199), list);
    chosen[n_chosen] = MODEL_output_index(name);
    if (chosen[n_chosen] < 0 || n_chosen == MODEL_n_y) return name;
    ++n_chosen;
    if (!list[length]) return NULL;
    list += length + 1;
  }
}

static int usage(const char *name) {
  printf("usage: %s [options]\n"
         "  --until TIME    end of the run, in s of the model; by default it runs until it is interrupted\n"
         "  --no-wait       as fast as possible, to measure the time of the steps\n"
         "  --processor-time  measure the processor time of the steps, without the time of other programs\n"
         "  --port PORT     receive inputs on this port of 127.0.0.1\n"
         "  --to PORT       send outputs to this port of 127.0.0.1\n"
         "  --outputs LIST  names of the outputs to send, separated by commas; by default all\n"
         "  --every N       send the outputs of every N-th step (default 1)\n"
         "  --lock-step     after outputs are sent, wait for a datagram with a later time than the last one\n"
         "  --priority N    use the real-time scheduler of the system (SCHED_FIFO) with this priority, and keep the memory in RAM\n"
         "  --set NAME=VALUE  value of a parameter, in SI units; may be repeated\n"
         "  --histogram     list the histogram of the step times\n",
         name);
  return 2;
}

static int number(const char *text, double low, double high, double *value) {
  char *end;
  *value = strtod(text, &end);
  return end != text && !*end && *value >= low && *value <= high;
}

int main(int argc, char **argv) {
  double until = INFINITY, port = 0, to_port = 0, every = 1, priority = 0, p[MODEL_n_p + 1], value, longest = 0, begin, end, after;
  int wait = 1, lock_step = 0, list = 0, udp = -1, k;
  uint64_t n = 0, n_overrun = 0;
  struct sockaddr_in own, to;
  clockid_t measured = CLOCK_MONOTONIC;
  MODEL_run *run = malloc(MODEL_size());
  memcpy(p, MODEL_p_start, sizeof(double) * MODEL_n_p);
  for (k = 0; k < MODEL_n_y; ++k) chosen[k] = k;
  for (k = 1; k < argc; ++k) {
    const char *option = argv[k], *text = k + 1 < argc ? argv[k + 1] : "";
    int valid = 1;
    if (!strcmp(option, "--no-wait")) wait = 0;
    else if (!strcmp(option, "--processor-time")) measured = CLOCK_THREAD_CPUTIME_ID;
    else if (!strcmp(option, "--lock-step")) lock_step = 1;
    else if (!strcmp(option, "--histogram")) list = 1;
    else if (++k, !strcmp(option, "--until")) valid = number(text, -1e300, 1e300, &until);
    else if (!strcmp(option, "--port")) valid = number(text, 1, 65535, &port);
    else if (!strcmp(option, "--to")) valid = number(text, 1, 65535, &to_port);
    else if (!strcmp(option, "--every")) valid = number(text, 1, 1e9, &every);
    else if (!strcmp(option, "--priority")) valid = number(text, 1, 99, &priority);
    else if (!strcmp(option, "--outputs")) {
      const char *unknown = choose_outputs(text);
      if (unknown) {
        fprintf(stderr, "--outputs: '%s' is not an output, or there are too many names; the outputs are:", unknown);
        for (k = 0; k < MODEL_n_y; ++k) fprintf(stderr, " %s", MODEL_output_names[k]);
        fprintf(stderr, "\n");
        return 2;
      }
    } else if (!strcmp(option, "--set")) {
      const char *equals = strchr(text, '=');
      char name[200] = "";
      int index;
      if (equals && equals - text < (long)sizeof name) memcpy(name, text, (size_t)(equals - text));
      index = MODEL_parameter_index(name);
      if (!equals || index < 0 || !number(equals + 1, -1e300, 1e300, &value)) {
        fprintf(stderr, "--set %s: %s\n", text, equals && index < 0 ? "there is no parameter of this name"
                                                                    : "give NAME=VALUE, with a number in SI units");
        return 2;
      }
      p[index] = value;
    } else {
      if (strcmp(option, "--help")) fprintf(stderr, "there is no option '%s'\n", option);
      return usage(argv[0]);
    }
    if (!valid) {
      fprintf(stderr, "%s: '%s' is not a number in its range\n", option, text);
      return 2;
    }
  }
  if (lock_step && !(port > 0 && to_port > 0)) {
    fprintf(stderr, "--lock-step needs --port and --to\n");
    return 2;
  }
  if (!run) return fprintf(stderr, "no memory\n"), 1;
  if (MODEL_init(run, p)) return fprintf(stderr, "%s\n", MODEL_message(run)), 1;
  if (!(until > MODEL_time(run))) return fprintf(stderr, "--until is not after the start, %g s\n", MODEL_time(run)), 2;
  if (port > 0 || to_port > 0) {
    memset(&own, 0, sizeof own);
    own.sin_family = AF_INET;
    own.sin_addr.s_addr = htonl(INADDR_LOOPBACK); /* this computer only */
    to = own;
    own.sin_port = htons((uint16_t)port);
    to.sin_port = htons((uint16_t)to_port);
    udp = socket(AF_INET, SOCK_DGRAM, 0);
    if (udp < 0 || bind(udp, (struct sockaddr *)&own, sizeof own)) return perror("--port"), 1;
  }
  if (priority > 0) {
    struct sched_param parameters;
    memset(&parameters, 0, sizeof parameters);
    parameters.sched_priority = (int)priority;
    if (sched_setscheduler(0, SCHED_FIFO, &parameters) || mlockall(MCL_CURRENT | MCL_FUTURE)) perror("--priority");
  }
  signal(SIGINT, interrupt);
  signal(SIGTERM, interrupt);
  begin = clock_time(CLOCK_MONOTONIC);
  after = -INFINITY;
  if (to_port > 0) send_outputs(udp, &to, run);
  while (!interrupted && MODEL_time(run) < until - 0.5 * MODEL_dt) {
    double before, taken;
    int bin, status;
    if (wait && !lock_step) wait_until(begin + (double)n * MODEL_dt);
    if (lock_step && n % (uint64_t)every == 0) {
      struct pollfd event;
      int accepted = 0, tries = 0;
      event.fd = udp, event.events = POLLIN;
      while (!accepted && !interrupted && tries < TRIES) {
        if (poll(&event, 1, PATIENCE) > 0) {
          accepted = read_inputs(udp, run, &after) > 0;
        } else {
          ++tries;
          send_outputs(udp, &to, run); /* the last datagram may be lost */
        }
      }
      if (!accepted) {
        if (!interrupted) fprintf(stderr, "no datagram was received within %d s\n", TRIES * PATIENCE / 1000);
        break;
      }
    } else if (port > 0 && !lock_step) {
      struct pollfd event;
      event.fd = udp, event.events = POLLIN;
      for (k = 0; k < MOST_READ && poll(&event, 1, 0) > 0; ++k) read_inputs(udp, run, NULL);
    }
    before = clock_time(measured);
    status = MODEL_step(run);
    taken = clock_time(measured) - before;
    if (status) {
      fprintf(stderr, "%s\n", MODEL_message(run));
      break;
    }
    ++n;
    if (to_port > 0 && n % (uint64_t)every == 0) send_outputs(udp, &to, run);
    if (taken > longest) longest = taken;
    bin = taken > 1e-9 ? (int)(BINS_IN_OCTAVE * log2(taken * 1e9)) : 0;
    ++histogram[bin < BINS ? bin : BINS - 1];
    if (wait && !lock_step && clock_time(CLOCK_MONOTONIC) > begin + (double)n * MODEL_dt) ++n_overrun;
  }
  end = clock_time(CLOCK_MONOTONIC);
  printf("steps       %llu of %g s, to %g s, in %.3g s\n", (unsigned long long)n, MODEL_dt, MODEL_time(run), end - begin);
  if (n)
    printf("%s   median %.3f us, 99.9 %% below %.3f us, maximum %.1f us\n",
           measured == CLOCK_MONOTONIC ? "step time" : "processor", 1e6 * quantile(0.5, n), 1e6 * quantile(0.999, n), 1e6 * longest);
  if (wait && !lock_step) printf("overruns    %llu steps ended after their period\n", (unsigned long long)n_overrun);
  printf("events      %lld steps with events at their end\n", MODEL_late(run));
  if (udp >= 0) printf("datagrams   %lu sent, %lu received, %lu rejected\n", n_sent, n_received, n_rejected);
  for (k = 0; k < BINS && list; ++k)
    if (histogram[k]) printf("%12.4g us %12llu\n", 1e-3 * pow(2, (double)k / BINS_IN_OCTAVE), (unsigned long long)histogram[k]);
  k = MODEL_message(run)[0] != 0;
  if (udp >= 0) close(udp);
  free(run);
  return k;
}
