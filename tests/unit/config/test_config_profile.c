/* SPDX-License-Identifier: MIT
 *
 * test_config_profile.c - fault profiles, and rules that are injected as text.
 */
#include "cases.h"
#include "configs.h"

TEST(profiles_take_parameters)
{
    CFG *config = load_good(GOOD "profiles.yaml");
    const cw_rule *r = config->rules;

    assert_int_equal(config->rule_count, 6);
    assert_string_equal(r[0].name, "costs");
    assert_string_equal(r[1].name, "first");
    assert_int_equal(r[1].from, 1);
    assert_int_equal(r[1].at, 2);
    assert_int_equal(r[1].time_begin, TICKS_PER_S);
    assert_int_equal(r[2].after, 1);
    assert_int_equal(r[2].node, 0);
    assert_string_equal(r[3].name, "again.first");
    assert_int_equal(r[3].from, 2);
    assert_int_equal(r[3].at, 1);
    assert_int_equal(r[3].time_begin, TICKS_PER_S * 3 / 2);
    assert_string_equal(r[4].name, "again.second");
    assert_int_equal(r[4].after, 3);
    assert_string_equal(r[5].name, "own");
    assert_int_equal(r[5].after, 4);
}

/* Loads rules from a text against config/profiles.yaml. After errors it returns NULL, with the
 * messages in *errors. */
static cfg_rules *inject(char **errors, const char *text, const cfg_running *running)
{
    CFG *config = load_good(GOOD "profiles.yaml");
    size_t length;
    FILE *out = open_memstream(errors, &length);
    cfg_rules *rules = cfg_load_rules(text, strlen(text), "text", config, running, out);

    fclose(out);
    assert_true((rules == NULL) == (length > 0));
    return rules;
}

TEST(rules_are_read_from_texts)
{
    static const char *const texts[] = {
        "{ name: x, do: { bus-off: engine } }",
        "{\"name\": \"x\", \"do\": {\"bus-off\": [\"engine\"]}}",
        "- { name: x, do: { bus-off: engine } }",
        "faults: [{ name: x, do: { bus-off: engine } }]",
        "{ parameters: { v: }, with: { v: engine }, faults: [{ name: x, do: { bus-off: $v } }] }",
        "{ parameters: { v: engine }, faults: [{ name: x, do: { bus-off: $v } }] }",
    };
    for (size_t i = 0; i < COUNT(texts); i++) {
        FREED char *errors;
        cfg_rules *rules = inject(&errors, texts[i], NULL);

        if (!rules)
            fail_msg("%s", errors);
        assert_int_equal(rules->count, 1);
        assert_string_equal(rules->rules[0].name, "x");
        assert_int_equal(rules->rules[0].nodes, 1);
        cfg_free_rules(rules);
    }
}

TEST(bad_texts_are_refused)
{
    static const struct {
        const char *text;
        const char *error;
    } cases[] = {
        {"", "text:1:1: there is no rule"},
        {"x", "text:1:1: expected a rule"},
        {"{ bus: { bitrate: 1 } }", "text:1:1: expected a rule"},
        {"{ name: x", "text:"},
        {"{ name: x }", "text:1:1: rule: the key 'do' is missing"},
        {"{ name: own, do: { flip: sof } }", "text:1:9: a rule 'own' is running already"},
        {"{ name: x, do: { bus-off: none } }", "text:1:27: bus-off: there is no node 'none'"},
        {"{ name: x, do: { flip: sof }, when: { after: { rule: y } } }",
         "text:1:54: rule: there is no rule 'y'"},
        {"{ parameters: { v: }, faults: [{ name: x, do: { bus-off: $v } }] }",
         "text:1:1: with: the parameter 'v' of the profile needs a value"},
        {"[{ name: x, do: { flip: sof }, when: { after: { rule: y } } },"
         " { name: y, do: { flip: sof }, when: { after: { rule: x } } }]",
         "text: there are rules that come after each other in a circle"},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        FREED char *errors;

        assert_null(inject(&errors, cases[i].text, NULL));
        if (strncmp(errors, cases[i].error, strlen(cases[i].error)) != 0)
            fail_msg("expected %s\ngot %s", cases[i].error, errors);
    }
}

/* A rule that comes after a later one is moved behind it; running rules keep their index. */
TEST(injected_rules_come_in_an_order_that_can_be_added)
{
    static const char text[] =
        "- { name: a, do: { flip: sof }, when: { after: { rule: b } } }\n"
        "- { name: b, do: { flip: sof }, when: { after: { rule: c } } }\n"
        "- { name: c, do: { flip: sof } }\n"
        "- { name: d, do: { flip: sof }, when: { after: { rule: live } } }\n";
    static const char *const names[] = {NULL, "other", "live"};
    static const cfg_running running = {.count = COUNT(names), .names = names};
    static const char *const order[] = {"c", "d", "b", "a"};
    static const unsigned after[] = {0, 2, 3, 5};
    FREED char *errors;
    cfg_rules *rules = inject(&errors, text, &running);

    assert_non_null(rules);
    assert_int_equal(rules->count, COUNT(order));
    for (size_t i = 0; i < COUNT(order); i++) {
        assert_string_equal(rules->rules[i].name, order[i]);
        assert_int_equal(rules->rules[i].has_after, i > 0);
        assert_int_equal(rules->rules[i].after, after[i]);
    }
    cfg_free_rules(rules);
}

TEST(a_profile_is_no_configuration)
{
    static const char path[] = "tests/config/profiles/two-rules.yaml";
    FREED char *text;
    size_t length;
    FILE *out = open_memstream(&text, &length);

    assert_null(cfg_load(path, out));
    fclose(out);
    assert_non_null(strstr(text, ":1:1: this is a fault profile"));
}
