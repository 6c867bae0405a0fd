/* SPDX-License-Identifier: MIT
 *
 * test_lines.c - lines of a peer: their ends, their limit of time, and their limit of size.
 */
#include "cases.h"
#include "base/wall.h"
#include "cli/lines.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <sys/socket.h>
#include <unistd.h>

#define SHORT_NS 20000000
#define ENOUGH_BYTES (1u << 20) /* of one who sends a byte now and then */

typedef struct rig {
    int here, there;
    lines_reader lines;
} rig;

static void start(rig *r)
{
    int ends[2];
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends), 0);
    *r = (rig){.here = ends[0], .there = ends[1]};
}

static void stop(rig *r)
{
    lines_free(&r->lines);
    (void)close(r->here);
    (void)close(r->there);
}

static void say(const rig *r, const char *text)
{
    assert_int_equal(send(r->there, text, strlen(text), MSG_NOSIGNAL), strlen(text));
}

static void assert_next(rig *r, int64_t until, const char *expected)
{
    const char *line = lines_next(&r->lines, r->here, until);
    assert_non_null(line);
    assert_string_equal(line, expected);
}

static void assert_none(rig *r, int64_t until, int error)
{
    assert_null(lines_next(&r->lines, r->here, until));
    assert_int_equal(errno, error);
}

TEST(lines_come_one_by_one)
{
    rig r;
    start(&r);
    say(&r, "one\ntwo\n\nth");
    assert_next(&r, LINES_NO_END, "one");
    assert_next(&r, LINES_NO_END, "two");
    assert_next(&r, LINES_NO_END, "");
    assert_none(&r, wall_ns() + SHORT_NS, EAGAIN);
    say(&r, "ree\nrest");
    assert_next(&r, LINES_NO_END, "three");
    assert_int_equal(shutdown(r.there, SHUT_WR), 0);
    assert_next(&r, LINES_NO_END, "rest");
    assert_none(&r, LINES_NO_END, 0);
    assert_none(&r, LINES_NO_END, 0);
    stop(&r);
}

/* A program that was stopped for a while finds the reply that has come in the meantime. */
TEST(what_is_there_is_found_after_the_end)
{
    rig r;
    start(&r);
    say(&r, "late\n");
    assert_next(&r, 0, "late");
    assert_none(&r, 0, EAGAIN);
    stop(&r);
}

static void *send_bytes(void *user)
{
    const rig *r = user;
    for (size_t i = 0; i < ENOUGH_BYTES; i++) {
        if (send(r->there, "a", 1, MSG_NOSIGNAL) != 1)
            break;
        (void)poll(NULL, 0, 1);
    }
    return NULL;
}

TEST(a_byte_now_and_then_gains_no_time)
{
    rig r;
    pthread_t sender;
    start(&r);
    assert_int_equal(pthread_create(&sender, NULL, send_bytes, &r), 0);
    for (size_t i = 0; i < 3; i++)
        assert_none(&r, wall_ns() + SHORT_NS, EAGAIN);
    (void)shutdown(r.here, SHUT_RDWR);
    assert_int_equal(pthread_join(sender, NULL), 0);
    stop(&r);
}

TEST(a_line_has_a_limit_of_size)
{
    FILE *zeros = tmpfile();
    lines_reader lines = {.shown = 0};
    assert_non_null(zeros);
    assert_int_equal(ftruncate(fileno(zeros), 4 * (off_t)LINES_MAX_BYTES), 0);
    assert_null(lines_next(&lines, fileno(zeros), LINES_NO_END));
    assert_int_equal(errno, EMSGSIZE);
    assert_true(lines.bytes.size <= 2 * LINES_MAX_BYTES);
    lines_free(&lines);
    (void)fclose(zeros);
}
