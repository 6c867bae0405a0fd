/* SPDX-License-Identifier: MIT
 *
 * vtimer.c - timers of a program in virtual time.
 *
 * A timerfd is an eventfd, to which the number of expirations is added: a read takes it in the same
 * way. alarm() and the timer ITIMER_REAL raise SIGALRM.
 */
#include "preload/vtimer.h"

#include "base/moment.h"
#include "preload/hooks/hook.h"
#include "preload/vtime.h"
#include "preload/waiting.h"

#include <signal.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/timerfd.h>
#include <unistd.h>

#define NS_PER_S INT64_C(1000000000)
#define FDS_MAX 64u
#define ALARM FDS_MAX /* the place of alarm() */

typedef struct vtimer {
    bool used;
    int fd;
    clockid_t clock;
    int64_t due_ns; /* VTIME_NEVER: it does not run */
    int64_t every_ns; /* 0: once */
} vtimer;

static vtimer all[FDS_MAX + 1] = {[ALARM] = {.used = true, .fd = -1, .due_ns = VTIME_NEVER}};
static unsigned highest; /* place of a timerfd that was ever used, and 1 */

static vtimer *vtimer_find(int fd)
{
    for (unsigned i = 0; i < highest; i++)
        if (all[i].used && all[i].fd == fd)
            return &all[i];
    return NULL;
}

bool vtimer_is_fd(int fd)
{
    return highest > 0 && vtimer_find(fd);
}

void vtimer_forget(int fd)
{
    vtimer *t = highest > 0 ? vtimer_find(fd) : NULL;
    if (t)
        t->used = false;
}

void vtimer_forked(void)
{
    all[ALARM].due_ns = VTIME_NEVER;
}

static void look_at(int64_t *due_ns, const vtimer *t)
{
    if (t->used && t->due_ns < *due_ns)
        *due_ns = t->due_ns;
}

int64_t vtimer_due_ns(void)
{
    int64_t due_ns = VTIME_NEVER;
    look_at(&due_ns, &all[ALARM]);
    for (unsigned i = 0; i < highest; i++)
        look_at(&due_ns, &all[i]);
    return due_ns;
}

/* Returns the number of expirations, and sets the next one. */
static uint64_t expire(vtimer *t, int64_t now_ns)
{
    if (!t->used || t->due_ns > now_ns)
        return 0;
    uint64_t count = 1;
    if (t->every_ns > 0)
        count += (uint64_t)((now_ns - t->due_ns) / t->every_ns);
    t->due_ns = t->every_ns > 0 ? t->due_ns + (int64_t)count * t->every_ns : VTIME_NEVER;
    return count;
}

bool vtimer_run(int64_t now_ns)
{
    for (unsigned i = 0; i < highest; i++) {
        const uint64_t count = expire(&all[i], now_ns);
        if (count > 0)
            (void)!real()->write(all[i].fd, &count, sizeof count);
    }
    if (expire(&all[ALARM], now_ns) == 0)
        return false;
    (void)raise(SIGALRM);
    return true;
}

static int64_t ns_of(const struct timespec *span)
{
    return span->tv_sec * NS_PER_S + span->tv_nsec;
}

/* ---- timerfd --------------------------------------------------------------------------------- */

HOOK int timerfd_create(int clock, int flags)
{
    unsigned place = 0;
    if (!vtime_is_on())
        return real()->timerfd_create(clock, flags);
    while (place < FDS_MAX && all[place].used)
        place++;
    if (place == FDS_MAX)
        return hook_result(EMFILE);
    const int fd = eventfd(0, (flags & TFD_CLOEXEC ? EFD_CLOEXEC : 0) |
                                  (flags & TFD_NONBLOCK ? EFD_NONBLOCK : 0));
    if (fd < 0)
        return fd;
    all[place] = (vtimer){.used = true, .fd = fd, .clock = clock, .due_ns = VTIME_NEVER};
    highest = place >= highest ? place + 1 : highest;
    return fd;
}

/* Tells the time left and the interval. A timer that is due has 1 ns left, since 0 means one that
 * is off. */
static void vtimer_tell(struct itimerspec *out, const vtimer *t)
{
    const int64_t left_ns = t->due_ns - vtime_now_ns();
    if (!out)
        return;
    out->it_interval = moment_of(t->every_ns);
    out->it_value = moment_of(t->due_ns == VTIME_NEVER ? 0 : left_ns > 0 ? left_ns : 1);
}

HOOK int timerfd_settime(int fd, int flags, const struct itimerspec *set, struct itimerspec *before)
{
    struct pollfd one = {.fd = fd, .events = POLLIN};
    uint64_t count;
    vtimer *t = highest > 0 ? vtimer_find(fd) : NULL;
    if (!t)
        return real()->timerfd_settime(fd, flags, set, before);
    const int64_t value_ns = ns_of(&set->it_value);
    vtimer_tell(before, t);
    if (real()->poll(&one, 1, 0) == 1)
        (void)!real()->read(fd, &count, sizeof count); /* earlier expirations are forgotten */
    t->every_ns = ns_of(&set->it_interval);
    t->due_ns = value_ns == 0                  ? VTIME_NEVER
                : flags & TFD_TIMER_ABSTIME ? vtime_of(t->clock, value_ns)
                                            : vtime_now_ns() + value_ns;
    count = expire(t, vtime_now_ns());
    if (count > 0)
        (void)!real()->write(fd, &count, sizeof count);
    return 0;
}

HOOK int timerfd_gettime(int fd, struct itimerspec *out)
{
    const vtimer *t = highest > 0 ? vtimer_find(fd) : NULL;
    if (!t)
        return real()->timerfd_gettime(fd, out);
    vtimer_tell(out, t);
    return 0;
}

/* ---- SIGALRM --------------------------------------------------------------------------------- */

static int64_t ns_of_us(const struct timeval *span)
{
    return span->tv_sec * NS_PER_S + span->tv_usec * 1000;
}

static struct timeval us_of(const struct timespec *span)
{
    return (struct timeval){.tv_sec = span->tv_sec, .tv_usec = (span->tv_nsec + 999) / 1000};
}

HOOK int getitimer(__itimer_which_t which, struct itimerval *out)
{
    struct itimerspec left;
    if (which != ITIMER_REAL || !vtime_is_on())
        return real()->getitimer((int)which, out);
    vtimer_tell(&left, &all[ALARM]);
    *out = (struct itimerval){.it_interval = us_of(&left.it_interval),
                              .it_value = us_of(&left.it_value)};
    return 0;
}

HOOK int setitimer(__itimer_which_t which, const struct itimerval *restrict set,
                   struct itimerval *restrict before)
{
    if (which != ITIMER_REAL || !vtime_is_on())
        return real()->setitimer((int)which, set, before);
    if (before)
        (void)getitimer(which, before);
    const int64_t value_ns = ns_of_us(&set->it_value);
    all[ALARM].every_ns = ns_of_us(&set->it_interval);
    all[ALARM].due_ns = value_ns == 0 ? VTIME_NEVER : vtime_now_ns() + value_ns;
    return 0;
}

HOOK unsigned alarm(unsigned seconds)
{
    struct itimerval before = {.it_value.tv_sec = 0};
    const struct itimerval set = {.it_value.tv_sec = (time_t)seconds};
    if (!vtime_is_on())
        return real()->alarm(seconds);
    (void)setitimer(ITIMER_REAL, &set, &before);
    return (unsigned)before.it_value.tv_sec + (before.it_value.tv_usec > 0);
}
