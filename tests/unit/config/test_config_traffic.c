/* SPDX-License-Identifier: MIT
 *
 * test_config_traffic.c - what the nodes of a configuration send: periodic frames, replays,
 * replies.
 */
#include "cases.h"
#include "configs.h"

TEST(traffic_is_read)
{
    CFG *config = load_good(GOOD "full.yaml");
    const cfg_node *load = &config->nodes[2];
    const cfg_traffic *t = load->traffic;

    assert_int_equal(load->traffic_count, 4);
    assert_int_equal(t[0].frame.id, 0x123);
    assert_int_equal(t[0].every.ns, 10000000);
    assert_int_equal(t[0].offset.ns, 1000000);
    assert_int_equal(t[0].count, 100);
    assert_true(t[0].has_every);
    assert_int_equal(t[1].frame.dlc, 15);
    assert_int_equal(t[1].every.bits, 100);
    assert_true(t[1].count == UINT64_MAX);
    assert_false(t[2].has_every);
    assert_int_equal(t[2].count, 1);
    assert_int_equal(t[2].offset.ns, 2000000000);
    assert_int_equal(t[3].count, 1);
}

TEST(jitter_replays_and_replies_are_read)
{
    CFG *config = load_good(GOOD "traffic.yaml");
    const cfg_traffic *t = config->nodes[0].traffic;

    assert_int_equal(t[0].kind, CFG_TRAFFIC_SEND);
    assert_int_equal(t[0].jitter.ns, 10000000);
    assert_int_equal(t[2].jitter.ns, 0);
    assert_true(cfg_traffic_is_endless(&t[2]));
    assert_false(cfg_traffic_is_endless(&t[0]));
    t = config->nodes[1].traffic;
    assert_int_equal(t[0].kind, CFG_TRAFFIC_REPLAY);
    assert_string_equal(t[0].file, GOOD "../../traces/candump/log.log");
    assert_int_equal(t[0].format, TRACE_DETECT);
    assert_int_equal(t[0].filter_count, 1);
    assert_int_equal(t[0].filters[0].mask, 0x700);
    assert_int_equal(t[0].count, 1);
    assert_false(t[0].fast);
    assert_null(t[0].channel);
    assert_int_equal(t[0].gap.ns, 1000000);
    assert_int_equal(t[1].format, TRACE_CANDUMP_DELTA);
    assert_int_equal(t[1].filter_count, 3);
    assert_true(t[1].filters[2].inverted);
    assert_string_equal(t[1].channel, "can-log1");
    assert_int_equal(t[1].offset.ns, 1000000000);
    assert_int_equal(t[1].count, 3);
    assert_int_equal(t[1].gap.ns, 20000000);
    assert_true(t[2].fast);
    assert_true(cfg_traffic_is_endless(&t[2]));
    assert_string_equal(t[3].channel, "1");
    t = config->nodes[2].traffic;
    assert_int_equal(config->reply_count, 3);
    assert_int_equal(t[0].kind, CFG_TRAFFIC_REPLY);
    assert_int_equal(t[0].filters[0].value, 0x123 | CW_FILTER_REMOTE);
    assert_int_equal(t[0].filters[0].mask, 0x7FF | CW_FILTER_REMOTE | CW_FILTER_EXTENDED);
    assert_false(cfg_traffic_is_endless(&t[0]));
    assert_int_equal(t[1].delay.ns, 250000);
    assert_int_equal(t[1].count, 4294967295);
    assert_int_equal(t[2].filter_count, 4);
}

TEST(files_of_traffic_need_not_be_there_when_files_are_given)
{
    static const char text[] = "bus: { bitrate: 500000 }\n"
                               "nodes: [ { name: a, traffic: [ { replay: nowhere.log } ] } ]\n";
    const cfg_file file = {.name = "bus.yaml", .text = text, .size = sizeof text - 1};

    CFG *config = cfg_load_given(&file, 1, stderr);
    assert_non_null(config);
    assert_int_equal(config->nodes[0].traffic_count, 1);
}
