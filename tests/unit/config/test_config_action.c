/* SPDX-License-Identifier: MIT
 *
 * test_config_action.c - the actions of fault rules in a configuration.
 */
#include "cases.h"
#include "configs.h"

TEST(actions_on_bits_are_read)
{
    CFG *config = load_good(GOOD "faults.yaml");
    const cw_rule *bits = rule_of(config, "force-bits");
    const cw_rule *time = rule_of(config, "force-time");
    const cw_rule *glitch = rule_of(config, "glitch");

    assert_int_equal(bits->action, CW_ACTION_FORCE);
    assert_true(bits->level == CW_DOMINANT);
    assert_int_equal(bits->field, CW_FIELD_DATA);
    assert_int_equal(bits->index, 8);
    assert_int_equal(bits->bits, 12);
    assert_int_equal(bits->for_ticks, 0);
    assert_int_equal(bits->at, 6);
    assert_true(time->level == CW_RECESSIVE);
    assert_int_equal(time->for_ticks, 80000);
    assert_int_equal(glitch->action, CW_ACTION_GLITCH);
    assert_int_equal(glitch->bits, 4);
    assert_int_equal(glitch->pattern_level, 9);
    assert_int_equal(glitch->pattern_mask, 11);
    assert_int_equal(glitch->field, CW_FIELD_STUFF);
    assert_int_equal(rule_of(config, "glitch-unquoted")->pattern_level, 6);
}

TEST(lasting_actions_are_read)
{
    CFG *config = load_good(GOOD "faults.yaml");
    const cw_rule *wire = rule_of(config, "stuck-wire");
    const cw_rule *tx = rule_of(config, "stuck-tx");
    const cw_rule *rx = rule_of(config, "stuck-rx");
    const cw_rule *noise = rule_of(config, "noise");
    const cw_rule *groups = rule_of(config, "partition");

    assert_int_equal(wire->action, CW_ACTION_STUCK);
    assert_int_equal(wire->line, CW_LINE_WIRE);
    assert_int_equal(wire->for_ticks, 0); /* the window ends it */
    assert_int_equal(tx->line, CW_LINE_TX);
    assert_int_equal(tx->node, 0);
    assert_int_equal(tx->for_ticks, 8000000);
    assert_int_equal(tx->dominant_timeout, 160000);
    assert_int_equal(rx->line, CW_LINE_RX);
    assert_int_equal(rx->node, 2);
    assert_true(rx->level == CW_RECESSIVE);
    assert_int_equal(rule_of(config, "stuck-node-called-wire")->node, 3);
    assert_true(noise->error_rate == UINT64_C(184467440737095));
    assert_int_equal(noise->at, 1);
    assert_true(rule_of(config, "noise-always")->error_rate == UINT64_MAX);
    assert_int_equal(rule_of(config, "no-ack")->nodes, 6);
    assert_int_equal(rule_of(config, "disconnect")->nodes, 3);
    assert_memory_equal(groups->group, "\0\0\1\2", 4);
}

TEST(controller_actions_are_read)
{
    CFG *config = load_good(GOOD "faults.yaml");
    const cw_rule *moment = rule_of(config, "moment");
    const cw_rule *until = rule_of(config, "until");
    const cw_rule *crc = rule_of(config, "wrong-crc");
    const cw_settings *set = &rule_of(config, "set-all")->settings;

    assert_int_equal(moment->tec, 255);
    assert_int_equal(moment->rec, CW_KEEP);
    assert_int_equal(until->nodes, 5);
    assert_int_equal(until->tec, 0);
    assert_int_equal(until->rec, 127);
    assert_int_equal(rule_of(config, "by-hand")->number, 2);
    assert_int_equal(rule_of(config, "overload")->number, 1);
    assert_int_equal(crc->nodes, 1);
    assert_int_equal(crc->from, 1); /* only its own frames are matches */
    assert_int_equal(rule_of(config, "wrong-crc-alone")->from, 3);
    assert_int_equal(set->which,
                     CW_SET_MODES | CW_SET_RESTART | CW_SET_QUEUE | CW_SET_ORDER | CW_SET_WARNING);
    assert_int_equal(set->modes_mask, 0x3F | CW_MODE_RESTRICTED | CW_MODE_TIME_TRIGGERED);
    assert_int_equal(set->modes, CW_MODE_ONE_SHOT | CW_MODE_PRESUME_ACK |
                                     CW_MODE_BERR_REPORTING |
                                     CW_MODE_LOST_ARBITRATION_REPORTING);
    assert_int_equal(set->restart_ticks, 8000000);
    assert_int_equal(set->queue, 32);
    assert_int_equal(set->order, CW_ORDER_FIFO);
    assert_int_equal(set->warning_limit, 10);
}

TEST(host_actions_are_read)
{
    CFG *config = load_good(GOOD "faults.yaml");
    const cw_change *change = &rule_of(config, "change")->change;

    assert_int_equal(rule_of(config, "drop-tx")->side, CW_SIDE_TX);
    assert_int_equal(rule_of(config, "drop-rx")->side, CW_SIDE_RX);
    assert_int_equal(rule_of(config, "delay")->side, CW_SIDE_TX);
    assert_int_equal(rule_of(config, "delay")->for_ticks, 400000);
    assert_int_equal(rule_of(config, "duplicate")->side, CW_SIDE_RX);
    assert_int_equal(rule_of(config, "duplicate")->number, 2);
    assert_int_equal(rule_of(config, "reorder")->side, CW_SIDE_RX);
    assert_int_equal(rule_of(config, "counter")->number, CW_COUNTER_REPEAT);
    assert_int_equal(rule_of(config, "counter")->side, CW_SIDE_TX);
    assert_int_equal(rule_of(config, "checksum")->side, CW_SIDE_TX);
    assert_true(change->set_id && change->set_dlc);
    assert_int_equal(change->id, 0x12345678);
    assert_int_equal(change->id_flags, CW_FRAME_EXTENDED);
    assert_int_equal(change->dlc, 15);
    assert_memory_equal(change->set_mask, "\x0F\x00\xFF\x00\x00\x00\x00\x00", 8);
    assert_memory_equal(change->set, "\x01\x00\xFF\x00\x00\x00\x00\x00", 8);
    assert_memory_equal(change->and_mask, "\x0F\xFF\xFF\xFF\xFF\xFF\xFF\xFF", 8);
    assert_memory_equal(change->or_mask, "\x00\x10\x00\x00\x00\x00\x00\x00", 8);
    assert_memory_equal(change->xor_mask, "\xFF\x00\x00\x00\x00\x00\x00\x00", 8);
}

TEST(traffic_actions_are_read)
{
    CFG *config = load_good(GOOD "faults.yaml");
    const cw_rule *send = rule_of(config, "send");
    const cw_rule *burst = rule_of(config, "burst");
    const cw_rule *reply = rule_of(config, "reply");

    assert_int_equal(send->frame.id, 0x123);
    assert_int_equal(send->node, 1);
    assert_int_equal(send->period_ticks, 0);
    assert_int_equal(burst->period_ticks, 800000);
    assert_int_equal(burst->time_end, 2 * TICKS_PER_S);
    assert_int_equal(rule_of(config, "babble")->for_ticks, 4000000);
    assert_int_equal(rule_of(config, "load")->load_permille, 625);
    assert_int_equal(rule_of(config, "load")->node, 2);
    assert_int_equal(reply->for_ticks, 80000);
    assert_int_equal(reply->filters[0].mask, 0xC00007FF);
}

/* An action that the library has and the configuration lacks is found here. test_schema.py compares
 * this file with the schema, and test_man.py the schema with the man page. */
TEST(each_action_of_the_library_is_read)
{
    CFG *config = load_good(GOOD "faults.yaml");

    for (unsigned action = 0; action < CW_ACTION_COUNT; action++) {
        bool found = false;

        for (size_t i = 0; i < config->rule_count; i++)
            found = found || config->rules[i].action == action;
        if (!found)
            fail_msg("no rule of faults.yaml has the action %s", cw_action_name(action));
    }
}
