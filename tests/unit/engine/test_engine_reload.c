/* SPDX-License-Identifier: MIT
 *
 * test_engine_reload.c - reloads that follow each other within one frame.
 *
 * The clock is ours and moves only when a test moves it, so that no frame ends by itself.
 */
#include "cases.h"
#include "engine_rig.h"

#define BIT_NS INT64_C(200000) /* at 5000 bit/s */
#define FRAME_BITS_MAX 160
#define BOUNDARY_BITS 1000 /* see engine_reload() */

typedef struct rig {
    engine_rig base;
    char path[PATH_BYTES]; /* of the configuration that is read next */
} rig;

static const char *const sender = "  - { name: load, traffic: [ "
                                  "{ send: 123#1122334455667788, every: 1s } ] }\n"
                                  "  - { name: ear }\n";

/* The sender's frame never ends: its receivers signal for as long as the wire is dominant. */
static const char *const jam = "faults:\n  - { name: jam, when: { time: 6ms }, "
                               "do: { stuck: dominant, for: 1s } }\n";

/* Writes the sender, its receiver, so many more nodes, and rules. */
static void write_config(const rig *r, unsigned nodes, const char *rules)
{
    FILE *out = fopen(r->path, "w");
    assert_non_null(out);
    fprintf(out, "bus: { name: reload, bitrate: 5000 }\ncatch-up: 1s\nnodes:\n%s", sender);
    for (unsigned i = 0; i < nodes; i++)
        fprintf(out, "  - { name: n%u }\n", i);
    fputs(rules, out);
    assert_int_equal(fclose(out), 0);
}

static void start_rig(rig *r, const char *rules)
{
    make_file(r->path, "reload");
    write_config(r, 0, rules);
    engine_rig_start(&r->base, cfg_load(r->path, stderr));
}

static void end_rig(rig *r)
{
    engine_rig_end(&r->base);
    assert_int_equal(unlink(r->path), 0);
}

static void pass_bits(rig *r, unsigned bits)
{
    clock_now_ns += bits * BIT_NS;
    engine_update(r->base.engine);
}

static void reload_to(rig *r, unsigned nodes, const char *rules)
{
    write_config(r, nodes, rules);
    engine_rig_reload(&r->base, r->path);
}

/* The bus changes to the last one of those that meet within a frame. */
TEST(a_reload_takes_the_place_of_one_under_way)
{
    rig r;
    start_rig(&r, "");
    pass_bits(&r, 20);
    assert_false(cw_bus_idle(engine_bus(r.base.engine)));
    for (unsigned nodes = 1; nodes <= 5; nodes++) {
        reload_to(&r, nodes, "");
        pass_bits(&r, 5);
        assert_int_equal(r.base.changes, 0);
        assert_int_equal(live_config(r.base.live)->node_count, 2);
    }
    pass_bits(&r, FRAME_BITS_MAX);
    assert_int_equal(r.base.changes, 1);
    assert_int_equal(live_config(r.base.live)->node_count, 2 + 5);
    end_rig(&r);
}

/* One that takes the place of another has no more time than that had. */
TEST(a_new_reload_does_not_put_off_the_end)
{
    rig r;
    start_rig(&r, jam);
    pass_bits(&r, 40);
    reload_to(&r, 1, jam);
    pass_bits(&r, BOUNDARY_BITS - 10);
    assert_int_equal(r.base.changes, 0);
    reload_to(&r, 2, jam);
    pass_bits(&r, 9);
    assert_int_equal(r.base.changes, 0);
    pass_bits(&r, 2);
    assert_int_equal(r.base.changes, 1);
    assert_int_equal(live_config(r.base.live)->node_count, 2 + 2);
    end_rig(&r);
}
