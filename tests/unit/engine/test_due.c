/* SPDX-License-Identifier: MIT
 *
 * test_due.c - an engine that sleeps until what is due sees each frame in time, and wakes up for
 * nothing else.
 */
#include "cases.h"
#include "run/due.h"

#include <unistd.h>

/* A bus of a configuration that goes from one moment that is due to the next. */
typedef struct sleeper {
    cfg *config;
    void *memory;
    cw_bus *bus;
    release_plan *plan;
    unsigned wakes;
    unsigned frames;
    unsigned drops;
} sleeper;

static void tell(void *user, bool failed, const char *text)
{
    (void)user;
    fail_msg("%d: %s", failed, text);
}

static cfg *load(const char *text)
{
    char path[] = "/tmp/canwire-due-XXXXXX";
    int fd = mkstemp(path);
    assert_int_equal(write(fd, text, strlen(text)), strlen(text));
    close(fd);
    cfg *config = cfg_load(path, stderr);
    unlink(path);
    assert_non_null(config);
    return config;
}

static sleeper begin(const char *text)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config wanted;
    sleeper s = {.config = load(text)};
    cfg_bus_config(&wanted, nodes, s.config);
    wanted.inbox = 64;
    wanted.events = 1024;
    s.memory = malloc(cw_bus_size(&wanted));
    s.bus = cw_bus_init(s.memory, &wanted);
    s.plan = release_plan_new(s.config, tell, NULL);
    assert_non_null(s.bus);
    assert_non_null(s.plan);
    return s;
}

static void end(sleeper *s)
{
    release_plan_free(s->plan);
    free(s->memory);
    cfg_free(s->config);
}

/* The end of a frame is visible at its very tick: the engine was not late by itself. */
static void look_at_events(sleeper *s, uint64_t now)
{
    cw_event event;
    while (cw_bus_poll(s->bus, &event)) {
        s->drops += event.kind == CW_EVENT_DROP;
        if (event.kind != CW_EVENT_RX && event.kind != CW_EVENT_TX)
            continue;
        s->frames += event.kind == CW_EVENT_TX;
        if (event.tick != now)
            fail_msg("an end of a frame at %llu was seen at %llu", (unsigned long long)event.tick,
                     (unsigned long long)now);
    }
}

static void run(sleeper *s, uint64_t until)
{
    uint64_t now;
    while ((now = due_tick(s->bus, s->plan, s->config)) <= until) {
        s->wakes++;
        while (release_next_tick(s->plan) <= now)
            assert_int_equal(release_hand_in(s->plan, s->bus), CW_OK);
        assert_int_equal(cw_bus_advance(s->bus, now), CW_OK);
        look_at_events(s, now);
    }
}

TEST(a_frame_on_an_idle_bus_costs_no_wake_up_before_its_end)
{
    sleeper s = begin("bus: { bitrate: 500000 }\n"
                      "nodes:\n"
                      "  - name: a\n"
                      "    traffic: [ { send: 123#DEADBEEF, every: 10ms, offset: 1003us } ]\n"
                      "  - { name: b }\n");
    run(&s, CW_CLOCK_HZ);
    assert_int_equal(s.frames, 100);
    assert_int_equal(s.wakes, 200); /* at the reception and at the end of the frame */
    end(&s);
}

/* Frames that come up together, behind each other, in the middle of bits and amid others. */
TEST(no_frame_is_seen_late)
{
    sleeper s = begin("bus: { bitrate: 500000 }\n"
                      "nodes:\n"
                      "  - name: a\n"
                      "    traffic:\n"
                      "      - { send: 700#1122334455667788, every: 3ms }\n"
                      "      - { send: 701#00, every: 1234567ns, offset: 5us, jitter: 900us }\n"
                      "  - name: b\n"
                      "    traffic:\n"
                      "      - { send: 100#, every: 3ms }\n"
                      "      - { send: 101#, every: 1501us, offset: 1us }\n"
                      "  - name: c\n"
                      "    traffic:\n"
                      "      - { send: 00000001#R, every: 777us, jitter: 300us }\n"
                      "      - { send: 102#FF, every: 3ms, offset: 2us }\n");
    run(&s, 3ull * CW_CLOCK_HZ);
    assert_true(s.frames > 10000);
    assert_true(s.wakes < 4 * s.frames);
    end(&s);
}

/* M15: a frame in loopback leaves the bus to others, and theirs may be shorter. */
TEST(a_frame_beside_one_in_loopback_is_not_seen_late)
{
    sleeper s = begin("bus: { bitrate: 500000 }\n"
                      "nodes:\n"
                      "  - name: a\n"
                      "    loopback: on\n"
                      "    traffic: [ { send: 123#A5A5A5A5A5A5A5A5, every: 3ms } ]\n"
                      "  - name: b\n"
                      "    traffic: [ { send: 101#R, every: 3001us, offset: 50us, count: 100 } ]\n"
                      "  - { name: c }\n");
    run(&s, CW_CLOCK_HZ);
    assert_int_equal(s.frames, 334 + 100);
    end(&s);
}

/* M6: b is in time for the end of the intermission, in which a frame waits, and wins. */
TEST(a_frame_that_overtakes_in_an_intermission_is_not_seen_late)
{
    sleeper s = begin("bus: { bitrate: 500000 }\n"
                      "nodes:\n"
                      "  - name: a\n"
                      "    traffic: [ { send: 555#55, count: 1 },\n"
                      "               { send: 701#A5A5A5A5A5A5A5A5, offset: 131us, count: 1 } ]\n"
                      "  - name: b\n"
                      "    traffic: [ { send: 101#R, offset: 135500ns, count: 1 } ]\n");
    run(&s, CW_CLOCK_HZ);
    assert_int_equal(s.frames, 3);
    end(&s);
}

/* M6: b comes in the SOF of a, wins, and is received a bit earlier than with a SOF of its own. */
TEST(a_frame_that_joins_a_start_is_not_seen_late)
{
    sleeper s = begin("bus: { bitrate: 500000 }\n"
                      "nodes:\n"
                      "  - name: a\n"
                      "    traffic: [ { send: 701#A5A5A5A5A5A5A5A5, offset: 1ms, count: 1 } ]\n"
                      "  - name: b\n"
                      "    traffic: [ { send: 555#R2, offset: 1001us, count: 1 } ]\n");
    run(&s, CW_CLOCK_HZ);
    assert_int_equal(s.frames, 2);
    end(&s);
}

/* A drop is reported at once. */
TEST(a_release_that_is_dropped_is_due_at_its_tick)
{
    sleeper s = begin("bus: { bitrate: 500000 }\n"
                      "nodes:\n"
                      "  - name: a\n"
                      "    listen-only: on\n"
                      "    traffic: [ { send: 123#, offset: 1ms } ]\n"
                      "  - { name: b }\n");
    assert_int_equal(due_tick(s.bus, s.plan, s.config), CW_CLOCK_HZ / 1000);
    run(&s, CW_CLOCK_HZ);
    assert_int_equal(s.drops, 1);
    end(&s);
}

/* The effect of rules on it is not known beforehand. */
TEST(where_rules_are_a_release_is_due_at_its_tick)
{
    sleeper s = begin("bus: { bitrate: 500000 }\n"
                      "nodes:\n"
                      "  - name: a\n"
                      "    traffic: [ { send: 123#, offset: 1ms } ]\n"
                      "  - { name: b }\n"
                      "faults: [ { name: gone, when: { frame: \"123\" }, do: { drop: tx } } ]\n");
    assert_int_equal(due_tick(s.bus, s.plan, s.config), CW_CLOCK_HZ / 1000);
    run(&s, CW_CLOCK_HZ);
    assert_int_equal(s.drops, 1);
    end(&s);
}
