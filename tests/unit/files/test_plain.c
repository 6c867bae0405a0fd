/* SPDX-License-Identifier: MIT
 *
 * test_plain.c - foreign text that is shown: on a terminal, in XML and in HTML.
 */
#include "cases.h"
#include "base/text/plain.h"
#include "base/text/xmltext.h"

typedef struct example {
    const char *text;
    const char *plain;
    const char *xml;
} example;

static const example examples[] = {
    {"a\u00E4\u20AC\U0001F697", "a\u00E4\u20AC\U0001F697", "a\u00E4\u20AC\U0001F697"},
    {"a\x1B[31m\x7F", "a?[31m?", "a?[31m?"},
    {"a\xC2\x9B" "1m", "a??1m", "a?1m"},
    {"a\u202Etxt.exe", "a???txt.exe", "a?txt.exe"},
    {"\u200B\u200F\u2028\u2066\u2069\uFEFF", "??????????????????", "??????"},
    {"\u061C\u00AD", "????", "??"},
    {"a\U000E0041b", "a????b", "a?b"},
    {"\uFFFE", "\uFFFE", "?"}, /* no character of XML */
    {"\xE2\x82", "??", "?"},
    {"\xFF<\x80>&", "?<?>&", "?&lt;?&gt;&amp;"},
    {"\u200A\u2010\u2027\u202F\u2070", "\u200A\u2010\u2027\u202F\u2070",
     "\u200A\u2010\u2027\u202F\u2070"},
};

TEST(text_is_made_plain)
{
    for (size_t i = 0; i < sizeof examples / sizeof examples[0]; i++) {
        FREED char *text = strdup(examples[i].text);
        assert_non_null(text);
        plain_make(text, '?');
        assert_string_equal(text, examples[i].plain);
        assert_false(plain_is_not(text));
    }
}

/* A name may have them where a language needs them. */
TEST(hidden_characters_are_no_control_characters)
{
    assert_false(plain_is_not("a\u200Cb\u2028c\r\n"));
    assert_true(plain_is_not("a\xC2\x9B"));
    assert_true(plain_is_not("a\xE2\x82"));
}

TEST(lines_stay)
{
    char text[] = "a\tb\n\x1B" "c\u202E\n";
    assert_true(plain_is_not(text));
    plain_make_lines(text, '?');
    assert_string_equal(text, "a\tb\n?c???\n");
}

TEST(xml_shows_each_such_character_once)
{
    for (size_t i = 0; i < sizeof examples / sizeof examples[0]; i++) {
        FREED char *got = NULL;
        size_t size = 0;
        FILE *out = open_memstream(&got, &size);
        assert_non_null(out);
        xml_value(out, examples[i].text);
        (void)fclose(out);
        assert_string_equal(got, examples[i].xml);
    }
}
