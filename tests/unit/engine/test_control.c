/* SPDX-License-Identifier: MIT
 *
 * test_control.c - live events at the control socket: who watches, what is lost, what is written at
 * the end.
 */
#include "cases.h"
#include "control_rig.h"

#include <fcntl.h>
#include <pthread.h>
#include <time.h>

/* ---- Events ---------------------------------------------------------------------------------- */

static void send_frame(rig *r)
{
    const cw_frame frame = {.id = 0x123, .dlc = 1, .data = {0xAB}};
    assert_int_equal(cw_node_send(r->engine.bus, 0, &frame, 0), CW_OK);
    engine_update(&r->engine);
}

CASE(watchers_see_what_they_asked_for)
{
    rig *r = *state;
    int all = connect_client(r), some = connect_client(r), none = connect_client(r);
    tell(r, all, "{\"request\":\"watch\"}");
    json_t *reply = grant(r, some, "{\"request\":\"watch\",\"events\":[\"tx\"]}");
    assert_int_equal(json_array_size(json_object_get(reply, "events")), 1);
    json_decref(reply);
    tell(r, none, "{\"request\":\"watch\"}");
    tell(r, none, "{\"request\":\"watch\",\"events\":[]}"); /* the last one counts */
    send_frame(r);
    assert_non_null(
        strstr(next_line(r, some), "\"node\":\"a\",\"event\":\"tx\",\"frame\":\"123#AB\""));
    assert_non_null(
        strstr(next_line(r, all), "\"node\":\"b\",\"event\":\"rx\",\"frame\":\"123#AB\""));
    assert_non_null(strstr(next_line(r, all), "\"node\":\"c\",\"event\":\"rx\""));
    assert_non_null(strstr(next_line(r, all), "\"event\":\"tx\""));
    tell(r, none, "{\"request\":\"faults\"}"); /* no event came before */
    tell(r, some, "{\"request\":\"faults\"}"); /* replies come in between */
    close(all);
    close(some);
    close(none);
}

CASE(injected_rules_have_their_names_in_events)
{
    rig *r = *state;
    int fd = connect_client(r);
    tell(r, fd, "{\"request\":\"watch\",\"events\":[\"fault\"]}");
    tell(r, fd,
         "{\"request\":\"inject\",\"text\":\"- {name: mine, when: {frame: \\\"123\\\", "
         "count: 1}, do: {flip: \\\"crc[3]\\\"}}\"}");
    send_frame(r);
    assert_non_null(strstr(next_line(r, fd), "\"event\":\"fault\",\"rule\":\"mine\",\"hit\":1}"));
    close(fd);
}

/* Events come all or are counted, and in the end their sum is right. */
CASE(slow_watchers_lose_events_and_are_told)
{
    rig *r = *state;
    int fd = connect_client(r);
    uint64_t sent = 0, got = 0, lost = 0;
    tell(r, fd, "{\"request\":\"watch\",\"events\":[\"tx\"]}");
    for (; sent < 20000; sent++) {
        send_frame(r);
        if (sent % 64 == 0)
            turn(r);
    }
    while (got + lost < sent) {
        json_auto_t *line = next_json(r, fd);
        if (json_object_get(line, "lost"))
            lost += (uint64_t)number(line, "lost");
        else
            got++;
    }
    assert_int_equal(got + lost, sent);
    assert_true(lost > 0 && got > 1000);
    send_frame(r);
    assert_non_null(strstr(next_line(r, fd), "\"tx\""));
    close(fd);
}

/* Counts lines until the server hangs up. */
static void *read_to_the_end(void *user)
{
    int *fd = user;
    char bytes[4096];
    uintptr_t lines = 0;
    for (ssize_t count; (count = recv(*fd, bytes, sizeof bytes, 0)) > 0;)
        for (ssize_t i = 0; i < count; i++)
            lines += bytes[i] == '\n';
    return (void *)lines;
}

/* The server stops while lines wait for a client that reads and for one that does not. */
CASE(what_waits_at_the_end_is_still_written)
{
    rig *r = *state;
    int reader = connect_client(r), sleeper = connect_client(r);
    tell(r, reader, "{\"request\":\"watch\",\"events\":[\"tx\"]}");
    tell(r, sleeper, "{\"request\":\"watch\",\"events\":[\"tx\"]}");
    for (unsigned i = 0; i < 3000; i++)
        send_frame(r);
    assert_int_equal(fcntl(reader, F_SETFL, 0), 0);
    pthread_t thread;
    void *lines;
    assert_int_equal(pthread_create(&thread, NULL, read_to_the_end, &reader), 0);
    control_stop(r->control);
    r->control = NULL;
    assert_int_equal(pthread_join(thread, &lines), 0);
    assert_int_equal((uintptr_t)lines, 3000);
    close(reader);
    close(sleeper);
}

/* ---- The bus meanwhile ----------------------------------------------------------------------- */

static int64_t now_us(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * INT64_C(1000000) + t.tv_nsec / 1000;
}

/* The bus must have its turn between any two requests of a client. */
CASE(a_heap_of_requests_leaves_time_for_the_bus)
{
    const rig *r = *state;
    int fds[16];
    unsigned served = 0, wakeups = 0;
    static char heap[2000 * 4 + 1];
    for (unsigned i = 0; i < 2000; i++)
        memcpy(heap + (size_t)4 * i, "[3]\n", 4);
    for (unsigned i = 0; i < 16; i++) {
        fds[i] = connect_client(r);
        assert_int_equal(send(fds[i], heap, sizeof heap - 1, MSG_NOSIGNAL), sizeof heap - 1);
    }
    int64_t longest_us = 0;
    while (served < 16 * 2000 && wakeups < PATIENCE_TURNS) {
        char replies[65536];
        int64_t start = now_us();
        turn(r);
        int64_t took = now_us() - start;
        longest_us = took > longest_us ? took : longest_us;
        wakeups++;
        for (unsigned i = 0; i < 16; i++) {
            ssize_t count = recv(fds[i], replies, sizeof replies, 0);
            for (ssize_t k = 0; k < count; k++)
                served += replies[k] == '\n';
        }
    }
    assert_int_equal(served, 16 * 2000);
    assert_true(wakeups >= 2000); /* one request of a client each */
    print_message("longest turn %lld us\n", (long long)longest_us);
    for (unsigned i = 0; i < 16; i++)
        close(fds[i]);
}
