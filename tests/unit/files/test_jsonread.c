/* SPDX-License-Identifier: MIT
 *
 * test_jsonread.c - JSON texts are read as jansson reads them, whatever is wrong with them.
 */
#include "cases.h"
#include "base/text/jsonread.h"

#include <jansson.h>
#include <stdlib.h>

#define TEXT_MAX 512u
#define CHANGED 200000u /* texts with something else in some places */

static jsonread reader;

/* ---- Beside jansson -------------------------------------------------------------------------- */

static void compare(const jsonread_value *v, const json_t *json);

static void compare_list(const jsonread_value *v, const json_t *json)
{
    size_t i = 0;
    const jsonread_value *item = jsonread_first(v);
    for (; item; item = jsonread_next(v, item)) {
        assert_null(item->key);
        compare(item, json_array_get(json, i++));
    }
    assert_int_equal(i, json_array_size(json));
}

static void compare_object(const jsonread_value *v, const json_t *json)
{
    size_t count = 0;
    const jsonread_value *last = NULL;
    const jsonread_value *item = jsonread_first(v);
    for (; item; item = jsonread_next(v, item), count++) {
        assert_int_equal(strlen(item->key), item->key_length);
        assert_ptr_equal(jsonread_get(v, item->key), item);
        assert_ptr_equal(jsonread_find(v, last, item->key, item->key_length), item);
        compare(item, json_object_get(json, item->key));
        last = item;
    }
    assert_int_equal(count, json_object_size(json));
    assert_null(jsonread_get(v, "no such key"));
}

/* A list or an object is there as it is written. */
static void compare_text(const jsonread_value *v, const json_t *json)
{
    json_t *again = json_loadb(v->text, v->length, JSON_DECODE_ANY, NULL);
    assert_true(json_equal(again, json));
    json_decref(again);
}

static void compare(const jsonread_value *v, const json_t *json)
{
    static const json_type types[] = {JSON_NULL, JSON_FALSE, JSON_TRUE, JSON_INTEGER,
                                      JSON_REAL, JSON_STRING, JSON_ARRAY, JSON_OBJECT};
    assert_non_null(json);
    assert_int_equal(types[v->kind], json_typeof(json));
    if (v->kind == JSONREAD_INTEGER || v->kind == JSONREAD_REAL)
        assert_true(jsonread_number(v) == json_number_value(json));
    if (v->kind == JSONREAD_STRING) {
        assert_string_equal(jsonread_string(v), json_string_value(json));
        assert_int_equal(v->length, json_string_length(json));
    }
    if (v->kind != JSONREAD_STRING)
        compare_text(v, json);
    if (v->kind == JSONREAD_LIST)
        compare_list(v, json);
    if (v->kind == JSONREAD_OBJECT)
        compare_object(v, json);
}

/* Returns true when the text is good. A number may be too large for jansson alone, whose 64 bits
 * have a sign. */
static bool read_both(const char *text, size_t length)
{
    json_error_t error;
    jsonread_problem problem;
    const jsonread_value *v = jsonread_text(&reader, &problem, text, length);
    json_t *json = json_loadb(text, length, JSON_REJECT_DUPLICATES | JSON_DECODE_ANY, &error);
    const bool large = !json && json_error_code(&error) == json_error_numeric_overflow;
    assert_true((v != NULL) == (problem == JSONREAD_GOOD));
    if (v && json)
        compare(v, json);
    else if (!large && (v || json))
        fail_msg("%s: %.*s: %s", v ? "taken" : "refused", (int)length, text, error.text);
    else if (!v && !large)
        assert_true((problem == JSONREAD_TWICE) ==
                    (json_error_code(&error) == json_error_duplicate_key));
    json_decref(json);
    return v != NULL;
}

static const char *const texts[] = {
    "{}", "[]", " [ ] ", "null", "true", "false", "7", "-0", "-12", "0.5", "1e3", "-1.25E-7",
    "\"\"", "\"a\\\"\\\\\\/\\b\\f\\n\\r\\t\\u0041\\u20AC\\ud83d\\ude00z\"",
    "\"\xC3\xA4 \xE2\x82\xAC \xF0\x9F\x98\x80 \xEF\xBB\xBF\"",
    "{\"a\":1,\"b\":[true,null,{\"c\":\"d\"},[]],\"\":{},\"e\":-1.5}",
    ("\n{ \"number\" : 0 ,\r\"factors\":{\"seed\":1},\t\"t\":0.100000000,\"nodes\":{\"engine\":"
    "{\"state\":\"error-active\",\"tec\":0,\"rec\":0}},\"lost\":[],\"repeat\":\"x --only 0\"}\n"),
    "[[[[[[1],2],3],4],5],6]", "9223372036854775807", "-9223372036854775808",
    "[1,22,333,4444,55555,666666,7777777,88888888]",
};

TEST(good_texts_are_those_of_jansson)
{
    for (size_t i = 0; i < COUNT(texts); i++)
        assert_true(read_both(texts[i], strlen(texts[i])));
}

TEST(bad_texts_are_those_of_jansson)
{
    static const char *const bad[] = {
        "", " ", "{", "}", "[", "]", "{]", "[}", "[1", "[1,", "[1,]", "[,1]", "{\"a\"}", "{\"a\":}",
        "{\"a\":1,}", "{,}", "{a:1}", "{1:1}", "{\"a\":1 \"b\":2}", "[1 2]", "1 2", "[] []",
        "nul", "nullx", "tru", "True", "+1", "01", "-", "--1", "1.", ".5", "1e", "1e+", "0x1",
        "1_0",
        "\"", "\"a", "\"\\\"", "\"\\x\"", "\"\\u12\"", "\"\\u12g4\"", "\"\\u0000\"",
        "\"\\ud800\"", "\"\\ud800x\"", "\"\\ud800\\u0041\"", "\"\\udc00\"", "\"\n\"",
        "\"\x80\"", "\"\xC0\x80\"", "\"\xE0\x80\x80\"", "\"\xED\xA0\x80\"", "\"\xF5\x80\x80\x80\"",
        "\"\xF0\x80\x80\x80\"", "\"\xF4\x90\x80\x80\"", "\"\xE2\x82\"", "{\"a\":1,\"a\":2}",
        "{\"a\":{\"b\":1,\"b\":2}}", "{\"\\u0061\":1,\"a\":2}", "[1]\v", "1e999", "[1e999]",
    };
    for (size_t i = 0; i < COUNT(bad); i++)
        if (read_both(bad[i], strlen(bad[i])))
            fail_msg("%s", bad[i]);
    assert_false(read_both("[1]\0", 4));
    assert_false(read_both("\"\0\"", 3));
}

TEST(keys_may_be_in_several_objects)
{
    static const char text[] = "{\"a\":{\"a\":{\"b\":1},\"b\":2},\"b\":{\"a\":3}}";
    assert_true(read_both(text, strlen(text)));
}

/* Lists in each other, as many as there may be, and one more. */
TEST(depth_has_a_limit)
{
    static char deep[2 * 2049];
    memset(deep, '[', 2049);
    memset(deep + 2049, ']', 2049);
    assert_true(read_both(deep + 1, 2 * 2048));
    assert_false(read_both(deep, 2 * 2049));
}

/* ---- Changed texts --------------------------------------------------------------------------- */

static uint64_t drawn(uint64_t *random)
{
    *random = *random * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return *random >> 33;
}

/* Changes, removes or doubles a few bytes. Returns the length. */
static size_t change(char text[TEXT_MAX], size_t length, uint64_t *random)
{
    static const char marks[] = "{}[]\",:\\0123456789.eE+-ntfu \x01\x80\xC3\xE2\xFF";
    for (uint64_t times = 1 + drawn(random) % 3; times > 0 && length > 0; times--) {
        const size_t at = drawn(random) % length;
        const uint64_t kind = drawn(random) % 4;
        if (kind == 0)
            memmove(text + at, text + at + 1, --length - at);
        else if (kind == 1 && length < TEXT_MAX)
            memmove(text + at + 1, text + at, length++ - at);
        else
            text[at] = marks[drawn(random) % (sizeof marks - 1)];
    }
    return length;
}

TEST(changed_texts_are_those_of_jansson)
{
    uint64_t random = 1;
    unsigned good = 0;
    for (unsigned i = 0; i < CHANGED; i++) {
        char text[TEXT_MAX];
        const char *from = texts[i % COUNT(texts)];
        memcpy(text, from, strlen(from));
        good += read_both(text, change(text, strlen(from), &random));
    }
    assert_in_range(good, CHANGED / 20, CHANGED / 2);
}

/* ---- Values ---------------------------------------------------------------------------------- */

TEST(numbers_have_64_bits)
{
    static const struct {
        const char *text;
        bool good;
        bool whole; /* and not below 0 */
        uint64_t value;
    } cases[] = {
        {"0", true, true, 0}, {"18446744073709551615", true, true, UINT64_MAX},
        {"18446744073709551616", false, false, 0}, {"-1", true, false, 0},
        {"-9223372036854775809", false, false, 0}, {"1.0", true, false, 0},
        {"\"1\"", true, false, 0}, {"99999999999999999999", false, false, 0},
        {"0.1234567890123456789012345", true, false, 0},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        jsonread_problem problem;
        uint64_t value = 77;
        const char *text = cases[i].text;
        const jsonread_value *v = jsonread_text(&reader, &problem, text, strlen(text));
        assert_int_equal(v != NULL, cases[i].good);
        assert_int_equal(jsonread_uint(&value, v), cases[i].whole);
        assert_true(value == (cases[i].whole ? cases[i].value : 77));
    }
}

TEST(values_are_equal_that_say_the_same)
{
    static const struct {
        const char *a;
        const char *b;
        bool same;
    } cases[] = {
        {"{\"a\":1,\"b\":[1,{\"c\":\"x\"},2.50]}",
         "{ \"b\" : [1,{\"c\":\"\\u0078\"},2.5], \"a\":1}",
         true},
        {"{\"a\":1,\"b\":2}", "{\"a\":2,\"b\":1}", false}, {"[1,2]", "[2,1]", false},
        {"[1,2]", "[1,2,3]", false}, {"{\"a\":1}", "{\"b\":1}", false}, {"1", "1.0", false},
        {"[[1],2]", "[1,[2]]", false}, {"null", "false", false}, {"\"1\"", "1", false},
        {"[[],{}]", "[[],{}]", true}, {"[{\"a\":[1,2]},3]", "[{\"a\":[1,2]},3]", true},
        {"[{\"a\":[1,2]},3]", "[{\"a\":[1,3]},3]", false},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        jsonread_problem problem;
        jsonread second = {.copy = NULL};
        const char *a = cases[i].a, *b = cases[i].b;
        const jsonread_value *v = jsonread_text(&reader, &problem, a, strlen(a));
        const jsonread_value *w = jsonread_text(&second, &problem, b, strlen(b));
        assert_true(jsonread_equals(v, w) == cases[i].same);
        assert_true(jsonread_equals(w, v) == cases[i].same);
        jsonread_free(&second);
    }
    assert_true(jsonread_equals(NULL, NULL));
}
