/* SPDX-License-Identifier: MIT
 *
 * test_recorder.c - recordings: files that are rotated, entries that stay whole, errors that end
 * them; and the queue to the disk under them.
 *
 * A limit of file size stands for a full disk. A write then gets some of the bytes into the file,
 * and the next one fails.
 */
#include "cases.h"
#include "base/text/number.h"
#include "base/thread.h"
#include "disk.h"
#include "record/recorder.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pthread.h>
#include <semaphore.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#define PATIENCE_S 60
#define FOLDER_MAX 64

static char node_name[] = "engine";
static char other_name[] = "gearbox";
static char folder[FOLDER_MAX];
static char path[FOLDER_MAX + 16];

static int make_folder(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/test_recorder.XXXXXX");
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/file", folder);
    return 0;
}

static int remove_folder(void **state)
{
    (void)state;
    char command[FOLDER_MAX + 16];
    snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command);
}

/* Returns the text of FILE, or with a number FILE.NUMBER, to be freed; NULL: there is none. */
static char *content(unsigned number)
{
    char name[sizeof path + 16];
    char *text = NULL;
    size_t size = 0;
    snprintf(name, sizeof name, number ? "%s.%u" : "%s", path, number);
    FILE *in = fopen(name, "re");
    if (!in)
        return NULL;
    if (getdelim(&text, &size, '\0', in) < 0)
        strcpy(text, ""); /* getdelim() has made some room */
    fclose(in);
    return text;
}

static void assert_content(unsigned number, const char *expected)
{
    FREED char *text = content(number);
    if (expected)
        assert_string_equal(text, expected);
    else
        assert_null(text);
}

static spool *open_spool(unsigned files)
{
    int error = 0;
    spool *s = spool_open(path, files, NULL, NULL, &error);
    assert_int_equal(error, 0);
    assert_non_null(s);
    return s;
}

static void write_text(spool *s, const char *text)
{
    assert_true(spool_write(s, text, strlen(text)));
}

#define IN_FOLDER(test) TEST_WITH(test, make_folder, remove_folder)

/* ---- The spool ------------------------------------------------------------------------------- */

IN_FOLDER(cuts_make_numbered_files_and_the_oldest_goes)
{
    spool *s = open_spool(3);
    const char *const parts[] = {"one\n", "two\n", "three\n", "four\n"};
    for (unsigned i = 0; i < 4; i++) {
        if (i > 0)
            assert_true(spool_cut(s));
        write_text(s, parts[i]);
    }
    assert_true(spool_close(s, PATIENCE_S));
    assert_content(0, "four\n");
    assert_content(1, "three\n");
    assert_content(2, "two\n");
    assert_content(3, NULL);
}

IN_FOLDER(a_file_that_is_there_is_rotated_and_with_one_file_replaced)
{
    for (unsigned i = 0; i < 2; i++) {
        spool *s = open_spool(2);
        write_text(s, i == 0 ? "old" : "new");
        assert_true(spool_close(s, PATIENCE_S));
    }
    assert_content(0, "new");
    assert_content(1, "old");
    spool *s = open_spool(1);
    write_text(s, "only");
    assert_true(spool_close(s, PATIENCE_S));
    assert_content(0, "only");
    assert_content(1, "old");
}

IN_FOLDER(an_empty_file_is_not_kept)
{
    for (unsigned i = 0; i < 2; i++)
        assert_true(spool_close(open_spool(5), PATIENCE_S));
    assert_content(0, "");
    assert_content(1, NULL);
}

IN_FOLDER(what_is_no_regular_file_stays_as_it_is)
{
    int error = 0;
    struct stat there;
    assert_int_equal(symlink("/dev/null", path), 0);
    assert_null(spool_open(path, 5, NULL, NULL, &error));
    assert_int_equal(error, EINVAL);
    assert_int_equal(lstat(path, &there), 0);
    assert_true(S_ISLNK(there.st_mode));
    assert_null(spool_open("/nowhere/at/all", 5, NULL, NULL, &error));
    assert_int_equal(error, ENOENT);
}

IN_FOLDER(all_of_much_more_than_the_queue_arrives_in_order)
{
    const size_t total = 5 * SPOOL_QUEUE_BYTES;
    char line[32];
    uint64_t expected = 0, sent = 0;
    spool *s = open_spool(1);
    int watch = disk_watch(path);
    for (size_t bytes = 0; bytes < total;) {
        size_t length = (size_t)snprintf(line, sizeof line, "%" PRIu64 "\n", sent);
        if (!spool_write(s, line, length)) {
            disk_wait(watch);
            continue;
        }
        bytes += length;
        sent++;
    }
    close(watch);
    assert_true(spool_close(s, PATIENCE_S));
    FILE *in = fopen(path, "re");
    assert_non_null(in);
    while (fgets(line, sizeof line, in))
        assert_int_equal(strtoull(line, NULL, 10), expected++);
    fclose(in);
    assert_int_equal(expected, sent);
}

static void limit_files(rlim_t bytes)
{
    struct rlimit limit;
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &limit), 0);
    limit.rlim_cur = bytes;
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
}

static void told(void *user)
{
    (void)sem_post(user);
}

/* Waits for the report of the thread. */
static void wait_for_news(sem_t *news)
{
    while (sem_wait(news) != 0)
        continue;
    (void)sem_destroy(news);
}

IN_FOLDER(a_full_disk_ends_it_behind_the_last_whole_record)
{
    sem_t news;
    int error = 0;
    (void)sem_init(&news, 0, 0);
    limit_files(100);
    spool *s = spool_open(path, 5, told, &news, &error);
    assert_non_null(s);
    for (unsigned i = 0; i < 20; i++)
        (void)spool_write(s, "0123456789abcd\n", 15);
    wait_for_news(&news);
    assert_true(spool_has_ended(s));
    limit_files(RLIM_INFINITY);
    assert_int_equal(spool_error(s), EFBIG);
    assert_int_equal(spool_room(s), 0);
    assert_false(spool_write(s, "x", 1));
    assert_false(spool_cut(s));
    assert_true(spool_close(s, PATIENCE_S));
    FREED char *text = content(0);
    assert_int_equal(strlen(text), 90); /* 6 of 15 bytes, not 100 */
}

/* ---- Recorders ------------------------------------------------------------------------------- */

static cfg_node nodes[] = {{.name = node_name}, {.name = other_name}};
static const cw_event sent = {
    .kind = CW_EVENT_TX, .nodes = 1, .frame = {.id = 0x123, .dlc = 2, .data = {0xCA, 0xFE}}};

static recorder *start_with_news(cfg *config, cfg_record_format format, uint64_t size,
                                 unsigned files, sem_t *news)
{
    const cfg_record what = {.file = path, .format = format, .size = size, .files = files};
    int error = 0;
    *config = (cfg){.bitrate_bps = 500000, .node_count = 2, .nodes = nodes};
    recorder *r = recorder_start(&what, config, NULL, news ? told : NULL, news, &error);
    assert_int_equal(error, 0);
    assert_non_null(r);
    return r;
}

static recorder *start(cfg *config, cfg_record_format format, uint64_t size, unsigned files)
{
    return start_with_news(config, format, size, files, NULL);
}

IN_FOLDER(a_log_has_the_given_times)
{
    cfg config;
    recorder_stats stats;
    recorder *r = start(&config, CFG_RECORD_CANDUMP, 100000, 5);
    const cw_event fault = {.kind = CW_EVENT_RX, .nodes = 1};
    recorder_event(r, &sent, UINT64_C(1700000000123456789));
    recorder_event(r, &fault, UINT64_C(1700000000123456789));
    assert_false(recorder_wants_bits(r));
    recorder_get_stats(r, &stats);
    assert_int_equal(stats.entries, 1);
    assert_int_equal(stats.lost, 0);
    assert_int_equal(stats.begun, 1);
    assert_true(recorder_close(r, PATIENCE_S));
    assert_content(0, "(1700000000.123456) engine 123#CAFE\n");
}

/* Reads a file to its end; returns the number of its frames. */
static unsigned count_frames(unsigned number)
{
    char name[sizeof path + 16];
    char problem[TRACE_PROBLEM_MAX];
    trace_record record;
    trace_result result;
    unsigned count = 0;
    snprintf(name, sizeof name, number ? "%s.%u" : "%s", path, number);
    trace_reader *reader = trace_open(name, TRACE_PCAPNG, problem);
    assert_non_null(reader);
    while ((result = trace_next(reader, &record)) == TRACE_RECORD)
        count += record.kind == TRACE_FRAME;
    assert_int_equal(result, TRACE_END);
    trace_close(reader);
    return count;
}

IN_FOLDER(each_capture_of_a_rotation_is_complete_and_nothing_is_between_them)
{
    cfg config;
    recorder_stats stats;
    recorder *r = start(&config, CFG_RECORD_PCAPNG, 2000, 100);
    unsigned frames = 0;
    for (uint64_t i = 0; i < 200; i++)
        recorder_event(r, &sent, i);
    recorder_get_stats(r, &stats);
    assert_true(recorder_close(r, PATIENCE_S));
    assert_int_equal(stats.entries, 200);
    assert_true(stats.begun > 5);
    for (unsigned i = 0; i < stats.begun; i++)
        frames += count_frames(i);
    assert_int_equal(frames, 200);
}

IN_FOLDER(other_nodes_begin_another_capture_but_no_other_log)
{
    static const cfg_record_format formats[] = {CFG_RECORD_PCAPNG, CFG_RECORD_CANDUMP};
    for (unsigned i = 0; i < 2; i++) {
        cfg config;
        recorder_stats stats;
        recorder *r = start(&config, formats[i], 100000, 5);
        recorder_event(r, &sent, 1);
        recorder_nodes_changed(r, NULL); /* they have not */
        recorder_get_stats(r, &stats);
        assert_int_equal(stats.begun, 1);
        config.node_count = 1;
        recorder_nodes_changed(r, NULL);
        recorder_event(r, &sent, 2);
        recorder_get_stats(r, &stats);
        assert_int_equal(stats.begun, formats[i] == CFG_RECORD_PCAPNG ? 2 : 1);
        assert_int_equal(stats.entries, 2);
        assert_true(recorder_close(r, PATIENCE_S));
        (void)remove_folder(NULL);
        assert_int_equal(mkdir(folder, 0700), 0);
    }
}

static unsigned count_lines(void)
{
    unsigned lines = 0;
    FILE *in = fopen(path, "re");
    assert_non_null(in);
    for (int c; (c = getc(in)) != EOF;)
        lines += c == '\n';
    fclose(in);
    return lines;
}

/* Whatever the disk is like. */
IN_FOLDER(an_entry_is_in_the_file_or_counted_as_lost)
{
    const uint64_t count = 1000000; /* several times the queue */
    cfg config;
    recorder_stats stats;
    recorder *r = start(&config, CFG_RECORD_CANDUMP, UINT64_MAX, 1);
    for (uint64_t i = 0; i < count; i++)
        recorder_event(r, &sent, i);
    recorder_get_stats(r, &stats);
    assert_true(recorder_close(r, PATIENCE_S));
    assert_int_equal(stats.entries + stats.lost, count);
    assert_int_equal(count_lines(), stats.entries);
}

IN_FOLDER(after_an_error_all_else_is_lost)
{
    cfg config;
    recorder_stats before, after;
    sem_t news;
    (void)sem_init(&news, 0, 0);
    limit_files(100);
    recorder *r = start_with_news(&config, CFG_RECORD_CANDUMP, 100000, 5, &news);
    for (uint64_t i = 0; i < 10; i++)
        recorder_event(r, &sent, i);
    wait_for_news(&news);
    assert_true(recorder_has_ended(r));
    limit_files(RLIM_INFINITY);
    assert_int_equal(recorder_error(r), EFBIG);
    recorder_get_stats(r, &before);
    recorder_event(r, &sent, 10);
    recorder_get_stats(r, &after);
    before.lost++;
    assert_memory_equal(&before, &after, sizeof before);
    assert_int_equal(after.entries + after.lost, 11);
    assert_int_equal(count_lines(), after.entries);
    assert_true(recorder_close(r, PATIENCE_S));
}

/* ---- Streams --------------------------------------------------------------------------------- */

static recorder *start_stream(cfg *config, cfg_record_format format, int fd)
{
    const cfg_record what = {.file = path, .format = format, .size = 1, .files = 1};
    int error = 0;
    *config = (cfg){.bitrate_bps = 500000, .node_count = 2, .nodes = nodes};
    recorder *r = recorder_start_stream(&what, config, fd, NULL, NULL, &error);
    assert_int_equal(error, 0);
    assert_non_null(r);
    return r;
}

static void *count_lines_of_pipe(void *in)
{
    size_t *lines = calloc(1, sizeof *lines);
    for (int c; (c = getc(in)) != EOF;)
        *lines += c == '\n';
    return lines;
}

TEST(what_a_slow_reader_misses_is_counted)
{
    const uint64_t count = 1000000; /* several times the queue and the pipe */
    cfg config;
    recorder_stats stats;
    pthread_t reader;
    size_t *lines;
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    FILE *in = fdopen(ends[0], "re");
    recorder *r = start_stream(&config, CFG_RECORD_CANDUMP, ends[1]);
    for (uint64_t i = 0; i < count; i++)
        recorder_event(r, &sent, i);
    recorder_get_stats(r, &stats);
    assert_true(stats.lost > count / 2);
    assert_int_equal(stats.entries + stats.lost, count);
    assert_int_equal(pthread_create(&reader, NULL, count_lines_of_pipe, in), 0);
    assert_true(recorder_close(r, PATIENCE_S)); /* the end of the pipe, too */
    assert_int_equal(pthread_join(reader, (void **)&lines), 0);
    assert_int_equal(*lines, stats.entries);
    free(lines);
    fclose(in);
}

IN_FOLDER(other_nodes_are_further_interfaces_of_a_stream)
{
    static const unsigned char section[] = {0x0A, 0x0D, 0x0D, 0x0A};
    cfg config;
    int fd = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    unsigned char bytes[4096];
    recorder *r = start_stream(&config, CFG_RECORD_PCAPNG, dup(fd));
    recorder_event(r, &sent, 1);
    config.node_count = 1;
    recorder_nodes_changed(r, NULL);
    recorder_event(r, &sent, 2);
    assert_true(recorder_close(r, PATIENCE_S));
    assert_int_equal(count_frames(0), 2);
    ssize_t size = pread(fd, bytes, sizeof bytes, 0);
    assert_true(size > 0 && size < (ssize_t)sizeof bytes);
    assert_memory_equal(bytes, section, sizeof section);
    assert_null(memmem(bytes + 4, (size_t)size - 4, section, sizeof section));
    close(fd);
}

TEST(a_stream_ends_with_its_reader)
{
    const struct timespec until = thread_in_seconds(PATIENCE_S);
    cfg config;
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    recorder *r = start_stream(&config, CFG_RECORD_CANDUMP, ends[1]);
    close(ends[0]);
    recorder_event(r, &sent, 1);
    assert_true(recorder_wait(r, &until));
    assert_int_equal(recorder_error(r), EPIPE);
    assert_true(recorder_close(r, PATIENCE_S));
}
