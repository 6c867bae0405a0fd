/* SPDX-License-Identifier: MIT
 *
 * test_invariants.c - what is true of a bus between two steps is asserted, each part of it.
 */
#include "rig.h"

#include "state/state.h"
#include "bus/invariants.h"

#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#define NODES 4

static rig *busy_bus(void)
{
    rig *r = rig_new(NODES);
    rig_start(r);
    for (unsigned i = 0; i < 2 * NODES; i++)
        assert_int_equal(cw_node_send(r->bus, i % NODES, &(cw_frame){.id = i, .dlc = 1}, 0), CW_OK);
    assert_int_equal(cw_bus_advance(r->bus, 200 * BIT), CW_OK);
    return r;
}

/* Returns true when a process that asserts the invariants of this bus ends. */
static bool is_refused(const cw_bus *bus)
{
    int status;
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        (void)setrlimit(RLIMIT_CORE, &(struct rlimit){0, 0});
        (void)close(STDERR_FILENO);
        (void)signal(SIGABRT, SIG_DFL);
        cw_assert_bus(bus);
        _exit(0);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    return !WIFEXITED(status) || WEXITSTATUS(status) != 0;
}

static void queued(cw_bus *bus)
{
    bus->queued++;
}
static void waiting(cw_bus *bus)
{
    bus->waiting = 0;
}
static void inbox_count(cw_bus *bus)
{
    bus->nodes[1].inbox++;
}
static void next_restart(cw_bus *bus)
{
    bus->restarts[1].at = 1;
}
static void counters(cw_bus *bus)
{
    bus->nodes[2].mac.confinement.tec = 200;
}
static void books(cw_bus *bus)
{
    bus->nodes[3].stats.handed_in++;
}
static void wires(cw_bus *bus)
{
    bus->groups[0] = 1;
}
static void load(cw_bus *bus)
{
    bus->load.bits++;
}
static void removed(cw_bus *bus)
{
    bus->removed = 1;
}
static void followers(cw_bus *bus)
{
    bus->followers |= UINT64_C(1) << NODES;
}
static void follower(cw_bus *bus)
{
    bus->followers = bus->all, bus->nodes[0].mac.no_ack = true;
}
static void frame(cw_bus *bus)
{
    bus->frame_step.contenders = 0;
}
static void resting(cw_bus *bus)
{
    bus->nodes[0].mac.phase = CW_MAC_FRAME;
}
static void outlook(cw_bus *bus)
{
    bus->outlook.senders = 0;
}
static void arbiter(cw_bus *bus)
{
    bus->arbiter.entries[0] = 0;
}
static void ring(cw_bus *bus)
{
    cw_ring_at(&bus->ring, bus->ring.count - 1)->tick = 0;
}

TEST(each_is_asserted)
{
    static void (*const spoil[])(cw_bus *) = {
        queued,  waiting,   inbox_count, next_restart, counters, books, wires,   load,
        removed, followers, follower,    frame,        resting,  outlook, arbiter, ring};
    for (size_t i = 0; i < sizeof spoil / sizeof spoil[0]; i++) {
        RIG *r = busy_bus();
        assert_true(r->bus->frame_step.active && r->bus->ring.count > 1);
        assert_false(is_refused(r->bus));
        spoil[i](r->bus);
        if (!is_refused(r->bus))
            fail_msg("%zu is not noticed", i);
    }
}
