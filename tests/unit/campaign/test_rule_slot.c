/* SPDX-License-Identifier: MIT
 *
 * test_rule_slot.c - factors that change one rule alone share a slot, whose values have numbers.
 */
#include "cases.h"
#include "campaign/space/rule_slot.h"

#include "campaigns.h"

static const char many[] = CAMPAIGN_HEAD
    "  - { set: faults.one.do.flip, values: [ \"crc[1]\", \"crc[2]\", \"crc[3]\" ] }\n"
    "  - { set: nodes.dash.queue, values: [ 3, 4 ] }\n"
    "  - { set: faults.two.when.skip, range: { from: 1, to: 5, step: 1 } }\n"
    "  - { name: p, pairs-of-bits: { frame: 123#11, at: dash, field: crc } }\n"
    "  - { set: \"faults[0].when.count\", range: { from: 1, to: 4, step: 1 } }\n"
    "  - { set: seed, range: { from: 1, to: 9, step: 1 } }\n";

TEST(factors_of_a_rule_have_one_slot)
{
    campaign *c = load_campaign(many);
    rule_slot slots[CAMPAIGN_FACTORS_MAX];
    assert_int_equal(rule_slot_find(slots, c), 3);
    assert_string_equal(slots[0].names[0], "one");
    assert_null(slots[0].names[1]);
    assert_int_equal(slots[0].factors, 1u << 0 | 1u << 4);
    assert_int_equal(slots[0].values, 12);
    assert_string_equal(slots[1].names[0], "two");
    assert_int_equal(slots[1].factors, 1u << 2);
    assert_int_equal(slots[1].values, 5);
    assert_string_equal(slots[2].names[0], "p.1");
    assert_string_equal(slots[2].names[1], "p.2");
    assert_int_equal(slots[2].values, 15 * 14 / 2);
    campaign_free(c);
}

/* Two rows have the same number exactly when they have the same values of the slot. */
TEST(each_combination_has_a_number_of_its_own)
{
    campaign *c = load_campaign(many);
    rule_slot slots[CAMPAIGN_FACTORS_MAX];
    bool seen[12] = {false};
    (void)rule_slot_find(slots, c);
    for (uint64_t flip = 0; flip < 3; flip++) {
        for (uint64_t count = 0; count < 4; count++) {
            choice choices[CAMPAIGN_FACTORS_MAX] = {{.index = flip}};
            choices[4].index = count;
            const uint64_t value = rule_slot_value(&slots[0], c, choices);
            assert_true(value < 12 && !seen[value]);
            seen[value] = true;
            choices[1].index = choices[2].index = choices[3].index = 1;
            choices[5].index = 7;
            assert_int_equal(rule_slot_value(&slots[0], c, choices), value);
        }
    }
    campaign_free(c);
}

/* Drawn values of a random sample have no numbers, and very many values no room. */
TEST(factors_without_numbers_have_no_slot)
{
    static const char drawn[] = "sample: { random: 10 }\n" CAMPAIGN_HEAD
        "  - { set: faults.one.when.skip, uniform: { from: 1, to: 9, step: 1 } }\n"
        "  - { set: faults.two.when.skip, range: { from: 1, to: 16384, step: 1 } }\n";
    static const char large[] = CAMPAIGN_HEAD
        "  - { set: faults.one.when.skip, uniform: { from: 1, to: 9, step: 1, draws: 5 } }\n"
        "  - { set: faults.two.when.skip, range: { from: 1, to: 16385, step: 1 } }\n";
    rule_slot slots[CAMPAIGN_FACTORS_MAX];
    campaign *c = load_campaign(drawn);
    assert_int_equal(rule_slot_find(slots, c), 1);
    assert_string_equal(slots[0].names[0], "two");
    assert_int_equal(slots[0].values, 16384);
    campaign_free(c);
    c = load_campaign(large);
    assert_int_equal(rule_slot_find(slots, c), 1);
    assert_string_equal(slots[0].names[0], "one");
    assert_int_equal(slots[0].values, 5);
    campaign_free(c);
}

static cfg *load_text(const char *text)
{
    cfg *config = cfg_load_text(&(cfg_file){.name = "bus", .text = text, .size = strlen(text)},
                                stderr);
    assert_non_null(config);
    return config;
}

TEST(a_slot_finds_its_rules_in_a_configuration)
{
    static const char bus[] = "bus: { bitrate: 500000 }\nnodes: [ { name: dash } ]\nfaults:\n"
        "  - { name: x, when: { frame: 123 }, do: { flip: sof } }\n"
        "  - { name: p.2, when: { frame: 123 }, do: { flip: sof } }\n"
        "  - { name: p.1, when: { frame: 123 }, do: { flip: sof } }\n";
    cfg *config = load_text(bus);
    rule_slot pair = {.names = {"p.1", "p.2"}, .values = 3};
    rule_slot other = {.names = {"p.1", "p.3"}, .values = 3};
    assert_true(rule_slot_begin(&pair, config));
    assert_int_equal(pair.index[0], 2);
    assert_int_equal(pair.index[1], 1);
    for (unsigned i = 0; i < 3; i++)
        assert_null(pair.rules[i]);
    pair.rules[1] = calloc(2, sizeof *pair.rules[1]);
    assert_true(rule_slot_begin(&pair, config)); /* ... and forgets what it had */
    assert_null(pair.rules[1]);
    assert_false(rule_slot_begin(&other, config));
    rule_slot_free(&pair);
    rule_slot_free(&other);
    cfg_free(config);
}
