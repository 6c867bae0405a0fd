/* SPDX-License-Identifier: MIT
 *
 * test_journal.c - a journal is written: into its file, beside old ones, with no room and with room
 * again.
 */
#include "cases.h"
#include "disk.h"
#include "journal_rig.h"

#include <jansson.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>

/* ---- Its file -------------------------------------------------------------------------------- */

TEST(a_journal_that_is_there_is_kept)
{
    host h;
    write_file("journal", "of last night\n");
    host_begin(&h, 1);
    host_end(&h);
    char *old = read_file("journal.1");
    assert_string_equal(old, "of last night\n");
    free(old);
    free(h.events.text);
}

TEST(a_journal_that_cannot_begin_says_why)
{
    char error[JOURNAL_ERROR_MAX];
    cfg *config = load_config(0);
    assert_null(journal_start(folder, 2, config, error));
    assert_non_null(strstr(error, "no regular file"));
    assert_null(journal_start("/nowhere/journal", 2, config, error));
    assert_string_equal(error, "journal /nowhere/journal: No such file or directory");
    cfg_free(config);
}

/* ---- Trouble --------------------------------------------------------------------------------- */

/* Runs in a process of its own, since the limit is permanent. */
static int journal_without_room(void)
{
    char error[JOURNAL_ERROR_MAX];
    const struct rlimit limit = {.rlim_cur = 4000, .rlim_max = 4000};
    const cw_frame frame = {.id = 0x123};
    host h;
    host_begin(&h, 1);
    if (!freopen("/dev/null", "we", stderr) || setrlimit(RLIMIT_FSIZE, &limit) != 0)
        return 2; /* the log may go to a file that is larger already */
    unlink(path_of("journal"));
    journal *full = journal_start(path_of("journal"), 2, live_config(h.live), error);
    inputs_observe(&h.inputs, journal_input, full);
    int watch = disk_watch(path_of("journal"));
    for (unsigned i = 0; i < 100000 && journal_lost(full) == 0; i++) {
        (void)inputs_send(&h.inputs, 0, &frame, 0);
        inputs_advance(&h.inputs, cw_bus_now(h.inputs.bus) + 100 * BIT);
        if (i % 100 == 99)
            disk_wait(watch);
        journal_mark(full, &h.inputs);
    }
    uint64_t lost = journal_lost(full);
    for (unsigned i = 0; i < 10; i++)
        (void)inputs_send(&h.inputs, 0, &frame, 0);
    return lost == 0 || journal_lost(full) != lost + 10;
}

TEST(a_full_disk_breaks_a_journal)
{
    char *events;
    char *messages;
    int status;
    fflush(stdout);
    pid_t child = fork();
    if (child == 0)
        _exit(journal_without_room());
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(status, 0);
    assert_int_equal(play(&events, &messages), JOURNAL_INCOMPLETE);
    assert_non_null(strstr(messages, "/journal: the journal is cut off at 0.0"));
    assert_non_null(strstr(events, "\"event\":\"tx\""));
    free(events);
    free(messages);
}

/* Waits until a broken journal is written again. */
static bool wait_for_state(journal *j, host *h, const char *wanted)
{
    int watch = disk_watch(path_of("journal"));
    bool is = false;
    for (unsigned i = 0; i < 10000 && !is; i++) {
        json_t *status = journal_to_json(j);
        is = strcmp(json_string_value(json_object_get(status, "state")), wanted) == 0;
        json_decref(status);
        if (is)
            break;
        inputs_advance(&h->inputs, cw_bus_now(h->inputs.bus) + 100 * BIT);
        journal_mark(j, &h->inputs);
        disk_wait(watch);
    }
    close(watch);
    return is;
}

/* Returns true when a broken journal reports its break behind the last line of the file. */
static bool tells_where_it_breaks(const journal *j)
{
    struct stat there;
    bool empty = stat(path_of("journal"), &there) == 0 && there.st_size == 0;
    char *text = empty ? NULL : read_text("journal");
    json_t *status = journal_to_json(j);
    const uint64_t told_ns =
        (uint64_t)json_integer_value(json_object_get(status, "broken_ns"));
    uint64_t last = 0;
    for (const char *line = text; line; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (strncmp(line, "{\"at\":", 6) == 0)
            last = strtoull(line + 6, NULL, 10);
    }
    json_decref(status);
    free(text);
    return told_ns == last * 25 / 2;
}

/* Runs in a process of its own: it gets room for more when it has had too little. */
static int journal_with_room_again(bool by_itself, rlim_t room)
{
    char error[JOURNAL_ERROR_MAX];
    struct rlimit limit = {.rlim_cur = room, .rlim_max = RLIM_INFINITY};
    const cw_frame frame = {.id = 0x123};
    host h;
    host_begin(&h, 1);
    if (!freopen("/dev/null", "we", stderr) || setrlimit(RLIMIT_FSIZE, &limit) != 0)
        return 2;
    for (unsigned i = 0; i < 4; i++)
        write_numbered(i, NULL, false);
    journal *full = journal_start(path_of("journal"), 2, live_config(h.live), error);
    inputs_observe(&h.inputs, journal_input, full);
    for (unsigned i = 0; i < 1000; i++) {
        (void)inputs_send(&h.inputs, 0, &frame, 0);
        inputs_advance(&h.inputs, cw_bus_now(h.inputs.bus) + 200 * BIT);
    }
    if (!wait_for_state(full, &h, "broken"))
        return 3;
    if (!tells_where_it_breaks(full))
        return 5;
    (void)inputs_send(&h.inputs, 1, &frame, 0);
    limit.rlim_cur = RLIM_INFINITY;
    (void)setrlimit(RLIMIT_FSIZE, &limit);
    if (!by_itself)
        journal_retry(full, &h.inputs);
    if (!wait_for_state(full, &h, "writing"))
        return 4;
    const cw_frame last = {.id = 0x7FF};
    (void)inputs_send(&h.inputs, 1, &last, 0);
    inputs_advance(&h.inputs, cw_bus_now(h.inputs.bus) + 300 * BIT);
    journal_stop(full, &h.inputs);
    return 0;
}

/* Bytes at first: for some lines, or not even for the first ones. */
static const rlim_t rooms[] = {4000, 1200, 100};

/* Checks what `canwire check` says of a journal with a gap: nothing else. */
static void check_gap(const char *bytes, size_t size)
{
    char *messages;
    assert_false(check_text(bytes, size, &messages));
    assert_non_null(strstr(messages, "nothing was written from 0."));
    assert_int_equal(strchr(messages, '\n')[1], 0);
    free(messages);
}

TEST(a_journal_is_taken_up_again)
{
    for (unsigned i = 0; i < 6; i++) {
        char *events;
        char *messages;
        int status;
        size_t size;
        fflush(stdout);
        pid_t child = fork();
        if (child == 0)
            _exit(journal_with_room_again(i % 2 == 0, rooms[i / 2]));
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_int_equal(status, 0);
        assert_int_equal(play(&events, &messages), JOURNAL_INCOMPLETE);
        assert_non_null(strstr(messages, "nothing was written from 0."));
        assert_non_null(strstr(messages, "(File too large), "));
        assert_null(strstr(messages, ", 0 lines"));
        free(events);
        free(messages);
        char *text = read_text("journal");
        char *packed = read_bytes("journal", &size);
        assert_non_null(strstr(text, "\"frame\":\"7FF#\""));
        assert_non_null(strstr(text, "\"nodes\":[{\"name\":\"a\",\"state\":\"error-active\""));
        check_gap(packed, size);
        check_gap(text, strlen(text));
        free(packed);
        free(text);
    }
}

/* It says where it is broken, and ends there. */
TEST(too_much_at_once_breaks_a_journal)
{
    enum { SIZE = 9 << 20 };
    char *text = malloc(SIZE);
    char *events;
    char *messages;
    memset(text, ' ', SIZE);
    host h;
    host_begin(&h, 1);
    inputs_advance(&h.inputs, 100 * BIT);
    const input large = {
        .kind = INPUT_INJECT, .now = 100 * BIT, .text = text, .size = SIZE, .name = "x"};
    journal_input(h.journal, &large);
    const cw_frame frame = {.id = 0x123};
    assert_int_equal(inputs_send(&h.inputs, 0, &frame, 0), CW_OK);
    inputs_advance(&h.inputs, 1000 * BIT);
    assert_int_equal(journal_lost(h.journal), 2);
    journal_mark(h.journal, &h.inputs);
    host_end(&h);
    assert_int_equal(play(&events, &messages), JOURNAL_INCOMPLETE);
    assert_non_null(strstr(messages, "nothing was written from 0.000000000 s to 0.002000000 s (the "
                                     "disk is too slow), 2 lines are missing"));
    assert_string_equal(events, "");
    free(text);
    free(events);
    free(messages);
    free(h.events.text);
}

/* The largest that a configuration can be. */
TEST(a_large_configuration_goes_into_it)
{
    enum { SIZE = 4000000 };
    char *text = malloc(SIZE + 1);
    char error[JOURNAL_ERROR_MAX];
    char *events;
    char *messages;
    memset(text, '\n', SIZE);
    memcpy(text, configs[1], strlen(configs[1]));
    text[SIZE] = '\0';
    write_file("bus.yaml", text);
    cfg *config = cfg_load(path_of("bus.yaml"), stderr);
    live *l = live_new(config);
    void *memory;
    inputs in;
    inputs_init(&in, l, bus_make(&memory, config), NULL, NULL);
    journal *j = journal_start(path_of("journal"), 2, live_config(l), error);
    assert_int_equal(journal_lost(j), 0);
    journal_stop(j, &in);
    assert_int_equal(play(&events, &messages), JOURNAL_PLAYED);
    assert_string_equal(messages, "");
    live_free(l);
    free(memory);
    free(text);
    free(events);
    free(messages);
}

TESTS_WITH(make_folder, remove_folder)
