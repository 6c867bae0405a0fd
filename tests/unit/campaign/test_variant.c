/* SPDX-License-Identifier: MIT
 *
 * test_variant.c - the scenario of a row is the text of the file with other values, and valid.
 */
#include "cases.h"
#include "campaign/space/variant.h"

#include "campaigns.h"

static const char many[] = CAMPAIGN_HEAD
    "  - { set: \"faults[1].do.flip\", values: [ \"crc[7]\", \"eof[0]\" ] }\n"
    "  - { set: seed, range: { from: 5, to: 7, step: 1 } }\n"
    "  - { set: bus.bitrate, values: [ 250000, 500000 ] }\n"
    "  - { name: s, each-bit: { frame: 123#11, at: dash } }\n"
    "  - { set: nodes.dash.queue, values: [ 3 ] }\n"
    "  - { name: p, pairs-of-bits: { frame: 123#11, at: dash, field: crc } }\n";

/* Writes the scenario of a row. */
static void print_row(buffer *out, const campaign *c, uint64_t row)
{
    choice choices[CAMPAIGN_FACTORS_MAX];
    buffer_clear(out);
    sample_choose(choices, c, row);
    variant_text(out, c, choices);
    assert_false(out->no_memory);
}

static cfg *load_row(const campaign *c, uint64_t row)
{
    buffer text = {.data = NULL};
    print_row(&text, c, row);
    const cfg_file file = {.name = "row", .text = buffer_first(&text),
                           .size = buffer_length(&text)};
    cfg *config = cfg_load_text(&file, stderr);
    buffer_free(&text);
    assert_non_null(config);
    return config;
}

TEST(a_row_without_changes_is_the_text)
{
    campaign *c = load_campaign(CAMPAIGN_HEAD "  - { set: bus.bitrate, values: [ 500000 ] }\n");
    buffer text = {.data = NULL};
    print_row(&text, c, 0);
    assert_int_equal(buffer_length(&text), c->size);
    assert_memory_equal(buffer_first(&text), c->text, c->size);
    buffer_free(&text);
    campaign_free(c);
}

static void assert_rule(const cfg *config, size_t number, const char *name, cw_field field,
                        unsigned index)
{
    const cw_rule *rule = &config->rules[number];
    assert_string_equal(rule->name, name);
    assert_int_equal(rule->field, field);
    assert_int_equal(rule->index, index);
}

/* Rules of spaces come first, in the order of the factors. */
TEST(all_values_of_a_row_are_in_its_scenario)
{
    campaign *c = load_campaign(many);
    for (uint64_t row = 0; row < c->rows; row += c->rows / 97) {
        choice choices[CAMPAIGN_FACTORS_MAX];
        uint64_t seed = 0;
        cfg *config = load_row(c, row);
        sample_choose(choices, c, row);
        assert_int_equal(config->rule_count, 5);
        assert_rule(config, 0, "s", CW_FIELD_BIT, (unsigned)choices[3].index);
        assert_string_equal(config->rules[1].name, "p.1");
        assert_string_equal(config->rules[2].name, "p.2");
        assert_rule(config, 3, "one", CW_FIELD_CRC, 3);
        assert_rule(config, 4, "two", choices[0].index ? CW_FIELD_EOF : CW_FIELD_CRC,
                    choices[0].index ? 0 : 7);
        assert_true(variant_seed(&seed, c, choices));
        assert_int_equal(seed, 5 + choices[1].index);
        assert_int_equal(config->seed, seed);
        assert_int_equal(config->bitrate_bps, choices[2].index ? 500000 : 250000);
        assert_int_equal(config->nodes[1].queue, 3);
        cfg_free(config);
    }
    campaign_free(c);
}

TEST(edits_come_in_the_order_of_the_text)
{
    campaign *c = load_campaign(many);
    size_t end = 0;
    uint64_t done = 0;
    unsigned count = 0;
    for (size_t i; (i = variant_next_edit(c, done)) != SIZE_MAX; done |= UINT64_C(1) << i) {
        assert_true(c->factors[i].edit.begin >= end);
        end = c->factors[i].edit.end;
        count++;
    }
    assert_int_equal(count, c->factor_count);
    campaign_free(c);
}

TEST(a_seed_that_does_not_vary_is_that_of_the_file)
{
    campaign *c = load_campaign(CAMPAIGN_HEAD "  - { set: bus.bitrate, values: [ 500000 ] }\n");
    choice choices[CAMPAIGN_FACTORS_MAX];
    uint64_t seed = 77;
    sample_choose(choices, c, 0);
    assert_false(variant_seed(&seed, c, choices));
    assert_int_equal(seed, 77);
    campaign_free(c);
}

TEST(the_largest_seed_is_exact)
{
    campaign *c = load_campaign(CAMPAIGN_HEAD
                                "  - { set: seed, values: [ 18446744073709551615, 12 ] }\n");
    choice choices[CAMPAIGN_FACTORS_MAX];
    uint64_t seed = 0;
    sample_choose(choices, c, 0);
    assert_true(variant_seed(&seed, c, choices));
    assert_true(seed == UINT64_MAX);
    sample_choose(choices, c, 1);
    assert_true(variant_seed(&seed, c, choices));
    assert_int_equal(seed, 12);
    campaign_free(c);
}
