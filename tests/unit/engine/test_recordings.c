/* SPDX-License-Identifier: MIT
 *
 * test_recordings.c - the end of several recordings on a disk that hangs.
 *
 * Their threads get write() and close() of this file, which can hang; so can the wait for them,
 * which then has no time to pass.
 */
#include "cases.h"
#include "base/thread.h"
#include "serve/recordings.h"

#include <errno.h>
#include <pthread.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define RECORDS 3
#define WAITS_MAX 64

static char folder[] = "/tmp/test_recordings.XXXXXX";
static pthread_t main_thread;

static struct {
    pthread_mutex_t lock; /* of what follows */
    pthread_cond_t changed;
    bool hangs;      /* the disk, for ever */
    bool last_ended; /* the file of the last recording has been closed */
} disk = {.lock = PTHREAD_MUTEX_INITIALIZER, .changed = PTHREAD_COND_INITIALIZER};

/* The waits of the main thread. */
static struct {
    unsigned count;
    unsigned timeouts;
    struct timespec until[WAITS_MAX];
} waits;

static bool is_file(int fd, const char *name)
{
    char link[64];
    char path[256];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0)
        return false;
    path[length] = '\0';
    const char *base = strrchr(path, '/');
    return strncmp(path, folder, strlen(folder)) == 0 && strcmp(base + 1, name) == 0;
}

/* Delays the first file until the end of the last one. */
ssize_t write(int fd, const void *bytes, size_t size)
{
    bool first = is_file(fd, "0.log");
    (void)pthread_mutex_lock(&disk.lock);
    while (!pthread_equal(pthread_self(), main_thread) &&
           (disk.hangs || (first && !disk.last_ended)))
        (void)pthread_cond_wait(&disk.changed, &disk.lock);
    (void)pthread_mutex_unlock(&disk.lock);
    return syscall(SYS_write, fd, bytes, size);
}

int close(int fd)
{
    bool last = is_file(fd, "2.log");
    int status = (int)syscall(SYS_close, fd);
    (void)pthread_mutex_lock(&disk.lock);
    disk.last_ended = disk.last_ended || last;
    (void)pthread_cond_broadcast(&disk.changed);
    (void)pthread_mutex_unlock(&disk.lock);
    return status;
}

static bool is_to_come(const struct timespec *until)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return until->tv_sec > now.tv_sec ||
           (until->tv_sec == now.tv_sec && until->tv_nsec > now.tv_nsec);
}

int pthread_cond_timedwait(pthread_cond_t *changed, pthread_mutex_t *lock,
                           const struct timespec *until)
{
    bool counts = pthread_equal(pthread_self(), main_thread) && is_to_come(until);
    if (counts && waits.count < WAITS_MAX)
        waits.until[waits.count++] = *until;
    int status = counts && disk.hangs
                     ? ETIMEDOUT
                     : pthread_cond_clockwait(changed, lock, CLOCK_MONOTONIC, until);
    waits.timeouts += counts && status == ETIMEDOUT;
    return status;
}

/* ---- Recordings ------------------------------------------------------------------------------ */

static char node_name[] = "engine";
static char files[RECORDS][sizeof folder + 8];
static cfg_node nodes[] = {{.name = node_name}};
static cfg_record records[RECORDS];

/* The buses of a rig: the first recording waits for the last one, which is of the other bus. */
static const cfg configs[] = {
    {.bitrate_bps = 500000, .node_count = 1, .nodes = nodes, .record_count = RECORDS - 1,
     .records = records},
    {.bitrate_bps = 500000, .node_count = 1, .nodes = nodes, .record_count = 1,
     .records = &records[RECORDS - 1]}};
#define BUSES (sizeof configs / sizeof configs[0])

static int set_up(void **state)
{
    (void)state;
    main_thread = pthread_self();
    memset(&waits, 0, sizeof waits);
    disk.last_ended = false;
    disk.hangs = false;
    strcpy(folder + sizeof folder - 7, "XXXXXX");
    assert_non_null(mkdtemp(folder));
    for (unsigned i = 0; i < RECORDS; i++) {
        snprintf(files[i], sizeof files[i], "%s/%u.log", folder, i);
        records[i] = (cfg_record){
            .file = files[i], .format = CFG_RECORD_CANDUMP, .size = 1000000, .files = 1};
    }
    return 0;
}

static int remove_all(void **state)
{
    (void)state;
    for (unsigned i = 0; i < RECORDS; i++)
        assert_int_equal(unlink(files[i]), 0);
    assert_int_equal(rmdir(folder), 0);
    return 0;
}

/* Begins all recordings, with an event in each, and ends them as canwired does. */
static void begin_and_stop(struct ev_loop *loop)
{
    const cw_event sent = {.kind = CW_EVENT_TX, .nodes = 1, .frame = {.id = 0x123}};
    recordings *all[BUSES];
    for (unsigned i = 0; i < BUSES; i++) {
        all[i] = recordings_start(loop, &configs[i], NULL, NULL, NULL);
        assert_non_null(all[i]);
        recordings_event(all[i], &sent, 1);
    }
    const struct timespec until = thread_in_seconds(RECORDINGS_PATIENCE_S);
    for (unsigned i = 0; i < BUSES; i++)
        recordings_finish(all[i]);
    for (unsigned i = 0; i < BUSES; i++)
        recordings_stop(all[i], &until);
}

#define IN_FOLDER(test) TEST_WITH(test, set_up, remove_all)

IN_FOLDER(all_end_before_one_is_waited_for)
{
    struct ev_loop *loop = ev_loop_new(0);
    begin_and_stop(loop);
    assert_int_equal(waits.timeouts, 0);
    for (unsigned i = 0; i < RECORDS; i++) {
        char line[64] = "";
        FILE *in = fopen(files[i], "re");
        assert_non_null(in);
        assert_non_null(fgets(line, sizeof line, in));
        fclose(in);
        assert_string_equal(line, "(0000000000.000000) engine 123#\n");
    }
    ev_loop_destroy(loop);
}

IN_FOLDER(a_disk_that_hangs_is_waited_for_once_and_not_for_each)
{
    struct ev_loop *loop = ev_loop_new(0);
    disk.hangs = true; /* and the threads with it: they are left behind */
    begin_and_stop(loop);
    assert_int_equal(waits.timeouts, RECORDS);
    for (unsigned i = 1; i < waits.count; i++)
        assert_memory_equal(&waits.until[i], &waits.until[0], sizeof waits.until[0]);
    ev_loop_destroy(loop);
}
