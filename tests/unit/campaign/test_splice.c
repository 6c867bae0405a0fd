/* SPDX-License-Identifier: MIT
 *
 * test_splice.c - a value is put into a YAML text, and all else of the text stays as it is.
 */
#include "cases.h"
#include "campaign/space/splice.h"

#include "base/text/yamlfile.h"

#define TEXT_BYTES 4096

/* A text with its document, and the memory of both. */
typedef struct paper {
    arena memory;
    yaml_document_t document;
    splice_text text;
} paper;

static void open_paper(paper *p, const char *text)
{
    static diag errors;
    errors = (diag){.file.name = "text"};
    *p = (paper){.text.text = NULL};
    if (!yaml_text_load(&p->document, text, strlen(text), &yaml_file_limits, &errors))
        fail_msg("%s\nis no YAML: %s", text, errors.messages[0].text);
    p->text = (splice_text){.text = text, .size = strlen(text), .document = &p->document,
                            .memory = &p->memory};
}

static void close_paper(paper *p)
{
    yaml_document_delete(&p->document);
    arena_free(&p->memory);
}

/* Puts a value in. Returns what is wrong with the path, or NULL. */
static const char *put(char out[TEXT_BYTES], const char *text, const char *path, const char *value)
{
    static char wrong[256];
    paper p;
    splice_place s = {.before = NULL};
    const char *rule;
    open_paper(&p, text);
    const char *problem = splice_find(&s, &p.text, path, &rule);
    if (!problem)
        (void)snprintf(out, TEXT_BYTES, "%.*s%s%s%s%s", (int)s.begin, text, s.before, value,
                       s.after, text + s.end);
    else
        (void)snprintf(wrong, sizeof wrong, "%s", problem);
    close_paper(&p);
    return problem ? wrong : NULL;
}

static void assert_put(const char *text, const char *path, const char *value, const char *expected)
{
    char found[TEXT_BYTES];
    const char *wrong = put(found, text, path, value);
    if (wrong)
        fail_msg("%s in\n%s\n%s", path, text, wrong);
    assert_string_equal(found, expected);
}

TEST(values_of_blocks_are_replaced)
{
    static const char text[] = "a: 1 # one\n\nb:\n  c: 2   # two\n  d: three\n# end\n";
    assert_put(text, "a", "7", "a: 7 # one\n\nb:\n  c: 2   # two\n  d: three\n# end\n");
    assert_put(text, "b.c", "7", "a: 1 # one\n\nb:\n  c: 7   # two\n  d: three\n# end\n");
    assert_put(text, "b.d", "\"x y\"", "a: 1 # one\n\nb:\n  c: 2   # two\n  d: \"x y\"\n# end\n");
    assert_put("b:\n  c: 2\nd: 3\n", "b", "[1]", "b:\n   [1]\nd: 3\n");
    assert_put("b:\n- 1\n- 2\nd: 3\n", "b", "[1]", "b:\n [1]\nd: 3\n");
    assert_put("a: |\n  two\n  lines\nb: 1\n", "a", "7", "a: 7\nb: 1\n");
    assert_put("a: two\n  lines\nb: 1\n", "a", "7", "a: 7\nb: 1\n");
}

TEST(values_of_flows_are_replaced)
{
    static const char text[] = "a: { b: 1, c: [ 2, 3 ], d: {e: 4} } # end\n";
    assert_put(text, "a.b", "7", "a: { b: 7, c: [ 2, 3 ], d: {e: 4} } # end\n");
    assert_put(text, "a.c", "7", "a: { b: 1, c: 7, d: {e: 4} } # end\n");
    assert_put(text, "a.c[1]", "7", "a: { b: 1, c: [ 2, 7 ], d: {e: 4} } # end\n");
    assert_put(text, "a.d.e", "7", "a: { b: 1, c: [ 2, 3 ], d: {e: 7} } # end\n");
    assert_put(text, "a", "7", "a: 7 # end\n");
    assert_put("{\"a\":{\"b\":1}}", "a.b", "\"x\"", "{\"a\":{\"b\":\"x\"}}");
}

TEST(quoted_values_are_replaced_with_their_quotes)
{
    assert_put("a: \"x # y: [ ]\" # z\nb: 1\n", "a", "7", "a: 7 # z\nb: 1\n");
    assert_put("a: 'it''s' # z\n", "a", "7", "a: 7 # z\n");
    assert_put("\"a\": { 'b': \"c\\\"d\" }\n", "a.b", "7", "\"a\": { 'b': 7 }\n");
}

TEST(items_have_numbers_and_names)
{
    static const char text[] = "n:\n  - name: x\n    v: 1\n  - { name: y, v: 2 }\n  - z\n";
    assert_put(text, "n.x.v", "7", "n:\n  - name: x\n    v: 7\n  - { name: y, v: 2 }\n  - z\n");
    assert_put(text, "n[0].v", "7", "n:\n  - name: x\n    v: 7\n  - { name: y, v: 2 }\n  - z\n");
    assert_put(text, "n.y.v", "7", "n:\n  - name: x\n    v: 1\n  - { name: y, v: 7 }\n  - z\n");
    assert_put(text, "n[2]", "7", "n:\n  - name: x\n    v: 1\n  - { name: y, v: 2 }\n  - 7\n");
}

TEST(keys_are_put_in)
{
    assert_put("a: 1\n", "b", "7", "b: 7\na: 1\n");
    assert_put("# c\na: { b: 1 }\n", "a.c", "7", "# c\na: { c: 7, b: 1 }\n");
    assert_put("a: {}\n", "a.c", "7", "a: {c: 7, }\n");
    assert_put("a:\n  b: 1 # one\n", "a.c", "7", "a:\n  c: 7\n  b: 1 # one\n");
    assert_put("n:\n  - name: x\n    v: 1\n", "n.x.w", "7",
               "n:\n  - w: 7\n    name: x\n    v: 1\n");
    assert_put("a:\nb: 1\n", "a", "7", "a: 7\nb: 1\n");
}

TEST(offsets_count_bytes_behind_other_characters)
{
    assert_put("# \xc3\xa4\xe2\x82\xac\xf0\x9f\x9a\x97\na: 1\n", "a", "7",
               "# \xc3\xa4\xe2\x82\xac\xf0\x9f\x9a\x97\na: 7\n");
    assert_put("{ x: \"\xc3\xa4\", a: 1 } # \xc3\xa4\n", "a", "7",
               "{ x: \"\xc3\xa4\", a: 7 } # \xc3\xa4\n");
    assert_put("\xEF\xBB\xBF" "a: 1\nb: 2\n", "b", "7", "\xEF\xBB\xBF" "a: 1\nb: 7\n");
    assert_put("\xEF\xBB\xBF" "a: 1\n", "b", "7", "\xEF\xBB\xBF" "b: 7\na: 1\n");
}

TEST(lines_of_other_systems_stay)
{
    static const char text[] = "a: 1\r\nb:\r\n  c: 2 # two\r\n  d: [ 3 ]\r\n";
    assert_put(text, "a", "7", "a: 7\r\nb:\r\n  c: 2 # two\r\n  d: [ 3 ]\r\n");
    assert_put(text, "b.c", "7", "a: 1\r\nb:\r\n  c: 7 # two\r\n  d: [ 3 ]\r\n");
    assert_put(text, "b.d[0]", "7", "a: 1\r\nb:\r\n  c: 2 # two\r\n  d: [ 7 ]\r\n");
    assert_put(text, "b", "7", "a: 1\r\nb:\r\n   7\r\n");
}

/* Finds the text of a value; "" when there is none. */
static void find_text(char out[TEXT_BYTES], const char *text, const char *path)
{
    paper p;
    splice_place s = {.begin = 0};
    const char *rule;
    out[0] = '\0';
    open_paper(&p, text);
    if (!splice_find(&s, &p.text, path, &rule))
        (void)snprintf(out, TEXT_BYTES, "%.*s", (int)(s.end - s.begin), text + s.begin);
    close_paper(&p);
}

static const char *const all_paths[] = {"a", "b", "b.c", "b.c[0]", "b.c[1]", "b.c[1].d", "b.e",
                                        "b.c[1].e", "e"};

static bool is_part_of(const char *path, const char *other)
{
    return strncmp(path, other, strlen(other)) == 0;
}

/* Puts a value in, and compares it and all others before and after. */
static void check_put(const char *text, const char *path, const char *value)
{
    char changed[TEXT_BYTES];
    assert_null(put(changed, text, path, value));
    for (size_t i = 0; i < COUNT(all_paths); i++) {
        char before[TEXT_BYTES];
        char after[TEXT_BYTES];
        const bool same = strcmp(path, all_paths[i]) == 0;
        if (!same && (is_part_of(path, all_paths[i]) || is_part_of(all_paths[i], path)))
            continue;
        find_text(before, text, all_paths[i]);
        find_text(after, changed, all_paths[i]);
        if (strcmp(after, same ? value : before) != 0)
            fail_msg("%s in\n%s\ngives\n%s\nand %s is %s", path, text, changed, all_paths[i],
                     after);
    }
}

TEST(what_is_put_in_is_found_there)
{
    static const char *const texts[] = {
        "a: 1\nb: { c: [ 2, { d: 3 } ] }\n",
        "a: \"\xc3\xa4\"\r\nb:\r\n  c:\r\n    - 2\r\n    - d: 3\r\n",
        "# x\na: |\n  one\n  two\nb:\n  c:\n  - 2 # two\n  -\n    d: 'x' # three\n\n",
        "{ \"a\": null, \"b\": { \"c\": [ 2, { \"d\": \"\" } ] } }"};
    static const char *const values[] = {"7", "\"x: # y\"", "[1,{\"q\":[]}]",
                                         "{\"q\":\"\\u00e4\"}"};
    for (size_t i = 0; i < COUNT(texts); i++)
        for (size_t k = 0; k < COUNT(all_paths); k++)
            for (size_t v = 0; v < COUNT(values); v++)
                check_put(texts[i], all_paths[k], values[v]);
}

static void assert_refused(const char *text, const char *path, const char *expected)
{
    char out[TEXT_BYTES];
    const char *wrong = put(out, text, path, "7");
    assert_non_null(wrong);
    assert_string_equal(wrong, expected);
}

TEST(paths_that_lead_nowhere_are_refused)
{
    assert_refused("a: { b: 1 }\n", "c.b", "the scenario has no 'c' there");
    assert_refused("a: { b: 1 }\n", "a.b.c", "the scenario has no 'c' there");
    assert_refused("a: [ 1 ]\n", "a[1]", "the scenario has no '1' there");
    assert_refused("a: [ 1 ]\n", "a.x", "the scenario has no 'x' there");
    assert_refused("a: &x [ 1 ]\nb: *x\n", "b[0]", "'b' is shared by an alias");
    assert_refused("a: 1\n", "a..b", "expected a key, or the name of an item: letters, digits, '_' "
                                     "and '-' at character 3");
}

TEST(the_rule_of_a_value_is_known)
{
    static const char text[] = "faults:\n  - { name: hit, do: { flip: sof } }\n"
                               "other: [ { name: hit } ]\n";
    static const char *const paths[] = {"faults.hit.do.flip", "faults[0].do", "faults.hit.when",
                                        "faults.hit.name", "faults", "other.hit.x", "faults.hit"};
    static const char *const rules[] = {"hit", "hit", "hit", NULL, NULL, NULL, NULL};
    for (size_t i = 0; i < COUNT(paths); i++) {
        paper p;
        splice_place s;
        const char *rule;
        open_paper(&p, text);
        assert_null(splice_find(&s, &p.text, paths[i], &rule));
        if (rules[i])
            assert_string_equal(rule, rules[i]);
        else
            assert_null(rule);
        close_paper(&p);
    }
}

static void assert_rules(const char *text, const char *expected)
{
    char found[TEXT_BYTES];
    paper p;
    splice_place a;
    splice_place b;
    open_paper(&p, text);
    assert_null(splice_find_rules(&a, &p.text, true, false));
    assert_null(splice_find_rules(&b, &p.text, false, true));
    assert_int_equal(a.begin, b.begin);
    (void)snprintf(found, TEXT_BYTES, "%.*s%s{1}%s{2}%s%s{3}%s%s", (int)a.begin, text, a.before,
                   a.between, a.after, b.before, b.after, text + b.end);
    assert_string_equal(found, expected);
    close_paper(&p);
}

TEST(rules_come_before_those_that_are_there)
{
    assert_rules("faults: [ { a: 1 } ]\n", "faults: [{1}, {2}, {3},  { a: 1 } ]\n");
    assert_rules("faults:\n  - a: 1\n", "faults:\n  - {1}\n  - {2}\n  - {3}\n  - a: 1\n");
    assert_rules("x: 1\n", "faults: [{1}, {2}, {3}]\nx: 1\n");
    assert_rules("{ x: 1 }", "{ faults: [{1}, {2}, {3}], x: 1 }");
}
