/* SPDX-License-Identifier: MIT
 *
 * test_config_rule.c - fault rules of a configuration: their conditions and the rules that they
 * wait for.
 */
#include "cases.h"
#include "configs.h"

TEST(rules_are_read)
{
    CFG *config = load_good(GOOD "full.yaml");
    const cw_rule *r = config->rules;

    assert_int_equal(config->rule_count, 3);
    assert_string_equal(r[0].name, "crc-flip");
    assert_int_equal(r[0].filter_count, 1);
    assert_int_equal(r[0].filters[0].mask, 0x800007FF);
    assert_int_equal(r[0].from, 1);
    assert_int_equal(r[0].time_begin, 2 * TICKS_PER_S);
    assert_int_equal(r[0].time_end, 5 * TICKS_PER_S);
    assert_int_equal(r[0].skip, 3);
    assert_int_equal(r[0].every, 10);
    assert_int_equal(r[0].count, 5);
    assert_true(r[0].probability == UINT64_C(1) << 63);
    assert_int_equal(r[0].action, CW_ACTION_FLIP);
    assert_int_equal(r[0].field, CW_FIELD_CRC);
    assert_int_equal(r[0].index, 3);
    assert_int_equal(r[0].bits, 2);
    assert_int_equal(r[0].at, 6);
    assert_int_equal(r[1].filter_count, 3);
    assert_int_equal(r[1].from, 5);
    assert_int_equal(r[1].time_begin, 64000);
    assert_true(r[1].time_end == CW_NEVER);
    assert_int_equal(r[1].index, 63);
    assert_int_equal(r[1].at, 1);
}

TEST(rule_defaults_act_always)
{
    CFG *config = load_good(GOOD "full.yaml");
    const cw_rule *rule = &config->rules[2];

    assert_int_equal(rule->filter_count, 0);
    assert_int_equal(rule->from, 0);
    assert_int_equal(rule->time_begin, 0);
    assert_true(rule->time_end == CW_NEVER);
    assert_int_equal(rule->skip, 0);
    assert_int_equal(rule->every, 1);
    assert_int_equal(rule->count, 0);
    assert_true(rule->probability == UINT64_MAX);
    assert_int_equal(rule->bits, 1);
    assert_int_equal(rule->at, 0);
}

TEST(rules_wait_for_what_is_written)
{
    static const struct {
        const char *name;
        cw_trigger trigger;
        uint64_t begin;
        uint64_t end;
    } cases[] = {
        {"list", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"errors", CW_TRIGGER_ERROR, 0, CW_NEVER},
        {"states", CW_TRIGGER_TIME, 0, CW_NEVER},
        {"sequence", CW_TRIGGER_ARMED, 0, CW_NEVER},
        {"by-hand", CW_TRIGGER_ARMED, 0, CW_NEVER},
        {"moment", CW_TRIGGER_TIME, 2 * TICKS_PER_S, CW_NEVER},
        {"until", CW_TRIGGER_FRAME, 0, 5 * TICKS_PER_S},
        {"armed-frame", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"force-bits", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"stuck-wire", CW_TRIGGER_TIME, TICKS_PER_S, 2 * TICKS_PER_S},
        {"wrong-crc-alone", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"overload", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"drop-rx", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"delay", CW_TRIGGER_FRAME, 0, CW_NEVER},
        {"send", CW_TRIGGER_TIME, 0, CW_NEVER},
        {"again", CW_TRIGGER_TIME, TICKS_PER_S, 9 * TICKS_PER_S},
        {"reply", CW_TRIGGER_FRAME, 0, CW_NEVER},
    };
    CFG *config = load_good(GOOD "faults.yaml");

    for (size_t i = 0; i < COUNT(cases); i++) {
        const cw_rule *rule = rule_of(config, cases[i].name);

        if (rule->trigger != cases[i].trigger)
            fail_msg("%s: trigger %d", cases[i].name, (int)rule->trigger);
        assert_true(rule->time_begin == cases[i].begin && rule->time_end == cases[i].end);
    }
}

TEST(conditions_are_read)
{
    CFG *config = load_good(GOOD "faults.yaml");
    const cw_rule *list = rule_of(config, "list");
    const cw_rule *errors = rule_of(config, "errors");
    const cw_rule *states = rule_of(config, "states");
    const cw_rule *sequence = rule_of(config, "sequence");

    assert_int_equal(list->filter_count, 3);
    assert_int_equal(list->filters[1].value, 0x456);
    assert_true(list->filters[2].inverted);
    assert_int_equal(list->data_length, 3);
    assert_memory_equal(list->data_mask, "\xFF\xFF\x0F", 3);
    assert_memory_equal(list->data_value, "\xDE\xAD\x01", 3);
    assert_int_equal(list->hold_off, 400000);
    assert_int_equal(list->again_ticks, 0);
    assert_int_equal(rule_of(config, "again")->again_ticks, TICKS_PER_S / 4);
    assert_int_equal(errors->error_mask, 0xC);
    assert_int_equal(errors->filter_count, 0);
    assert_int_equal(errors->from, 2);
    assert_int_equal(states->state_nodes, 3);
    assert_int_equal(states->state_mask, 1u << CW_STATE_ERROR_PASSIVE | 1u << CW_STATE_BUS_OFF);
    assert_true(sequence->has_after);
    assert_string_equal(config->rules[sequence->after].name, "by-hand");
    assert_int_equal(sequence->after_delay, 20 * 160);
    assert_true(rule_of(config, "by-hand")->manual);
    assert_true(rule_of(config, "armed-frame")->has_after);
}

/* Loads rules where node 0 knows CAN FD frames and the others do not. Returns NULL after errors,
 * with the messages in *errors. */
static cfg_rules *load_fd(char **errors, const char *text)
{
    CFG *config = load_good(GOOD "full.yaml");
    size_t length;
    FILE *out = open_memstream(errors, &length);

    config->nodes[0].kind = CFG_KIND_FD;
    cfg_rules *rules = cfg_load_rules(text, strlen(text), "text", config, NULL, out);
    fclose(out);
    return rules;
}

TEST(rules_may_ask_for_fd_frames)
{
    static const char text[] =
        "[{ name: a, when: { rate: data, data: 00..2233445566778899 }, do: { flip: brs } },"
        " { name: b, when: { frame: \"#8\", rate: nominal }, do: { send: 123##1AA, as: engine } },"
        " { name: c, do: { change: { or: \"00112233445566778899\" } } },"
        " { name: d, do: { flip: \"data[63.7]\" } },"
        " { name: e, when: { rate: data }, do: { send: 1FFFFFFF##2112233445566778899,"
        "   as: engine } }]";
    FREED char *errors;
    cfg_rules *rules = load_fd(&errors, text);

    if (!rules)
        fail_msg("%s", errors);
    const cw_rule *r = rules->rules;
    assert_int_equal(r[0].trigger, CW_TRIGGER_FRAME);
    assert_int_equal(r[0].rate, CW_RATE_DATA);
    assert_int_equal(r[0].field, CW_FIELD_BRS);
    assert_int_equal(r[0].data_length, 10);
    assert_int_equal(r[0].data_mask[1], 0);
    assert_int_equal(r[0].data_value[9], 0x99);
    assert_int_equal(r[1].trigger, CW_TRIGGER_ERROR);
    assert_int_equal(r[1].rate, CW_RATE_NOMINAL);
    assert_int_equal(r[1].frame.flags, CW_FRAME_FD | CW_FRAME_BRS);
    assert_int_equal(r[2].rate, CW_RATE_ANY);
    assert_int_equal(r[2].change.or_mask[9], 0x99);
    assert_int_equal(r[3].index, 511);
    assert_int_equal(r[4].trigger, CW_TRIGGER_FRAME); /* the rate alone is a condition on frames */
    assert_int_equal(r[4].frame.flags, CW_FRAME_FD | CW_FRAME_ESI | CW_FRAME_EXTENDED);
    assert_int_equal(r[4].frame.dlc, 9); /* filled up to 12 bytes */
    cfg_free_rules(rules);
}

TEST(nodes_send_what_they_know)
{
    static const struct {
        const char *text;
        const char *expected;
    } cases[] = {
        {"{ name: x, do: { send: 123##1AA, as: gearbox } }",
         "text:1:24: send: '123##1AA': a CAN FD frame (##), but the node 'gearbox' knows classical "
         "frames only (kind: fd makes it know both)\n"},
        {"{ name: x, do: { babble: 123##1AA, as: gearbox, every: 1ms } }",
         "text:1:26: babble: '123##1AA': a CAN FD frame (##), but the node 'gearbox' knows"},
        {"{ name: x, do: { reply: 123##1AA, as: gearbox } }",
         "text:1:25: reply: '123##1AA': a CAN FD frame (##), but the node 'gearbox' knows"},
        {"{ name: x, do: { reply: 123##gAA, as: engine } }",
         "text:1:25: reply: '123##gAA': expected a CAN FD frame such as 123##1DEADBEEF"},
        {"{ name: x, when: { rate: fast }, do: { flip: sof } }",
         "text:1:26: rate: expected one of nominal, data"},
        {"{ name: x, do: { flip: \"stuff-count[4]\" } }",
         "text:1:24: flip: 'stuff-count[4]': expected a position: sof id[0..28] srr ide rtr r0 r1 "
         "fdf res brs"},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        FREED char *errors;

        assert_null(load_fd(&errors, cases[i].text));
        if (strncmp(errors, cases[i].expected, strlen(cases[i].expected)) != 0)
            fail_msg("expected %s\ngot %s", cases[i].expected, errors);
    }
}
