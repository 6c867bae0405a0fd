/* SPDX-License-Identifier: MIT
 *
 * test_config_rule.c - fault rules of a configuration: their conditions and the rules that they
 * wait for.
 */
#include "configs.h"

static void rules_are_read(void **state)
{
    cfg *config = load_good(GOOD "full.yaml");
    const cw_rule *r = config->rules;

    (void)state;
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
    cfg_free(config);
}

static void rule_defaults_act_always(void **state)
{
    cfg *config = load_good(GOOD "full.yaml");
    const cw_rule *rule = &config->rules[2];

    (void)state;
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
    cfg_free(config);
}

static void rules_wait_for_what_is_written(void **state)
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
        {"reply", CW_TRIGGER_FRAME, 0, CW_NEVER},
    };
    cfg *config = load_good(GOOD "faults.yaml");

    (void)state;
    for (size_t i = 0; i < COUNT(cases); i++) {
        const cw_rule *rule = rule_of(config, cases[i].name);

        if (rule->trigger != cases[i].trigger)
            fail_msg("%s: trigger %d", cases[i].name, (int)rule->trigger);
        assert_true(rule->time_begin == cases[i].begin && rule->time_end == cases[i].end);
    }
    cfg_free(config);
}

static void conditions_are_read(void **state)
{
    cfg *config = load_good(GOOD "faults.yaml");
    const cw_rule *list = rule_of(config, "list");
    const cw_rule *errors = rule_of(config, "errors");
    const cw_rule *states = rule_of(config, "states");
    const cw_rule *sequence = rule_of(config, "sequence");

    (void)state;
    assert_int_equal(list->filter_count, 3);
    assert_int_equal(list->filters[1].value, 0x456);
    assert_true(list->filters[2].inverted);
    assert_int_equal(list->data_length, 3);
    assert_memory_equal(list->data_mask, "\xFF\xFF\x0F", 3);
    assert_memory_equal(list->data_value, "\xDE\xAD\x01", 3);
    assert_int_equal(list->hold_off, 400000);
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
    cfg_free(config);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rules_are_read),
        cmocka_unit_test(rule_defaults_act_always),
        cmocka_unit_test(rules_wait_for_what_is_written),
        cmocka_unit_test(conditions_are_read),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
