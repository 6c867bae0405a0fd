/* SPDX-License-Identifier: MIT
 *
 * shellword.c - writes a command line that a shell reads as it was.
 */
#include "campaign/shellword.h"

#include <string.h>

static const char harmless[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                               "_-./:=,+@%";

void shellword_put(rowtext *line, const char *word)
{
    if (*word && word[strspn(word, harmless)] == '\0') {
        rowtext_put(line, word);
        return;
    }
    rowtext_put(line, "'");
    for (const char *at = word; *at; at++) {
        const char one[] = {*at, '\0'};
        rowtext_put(line, *at == '\'' ? "'\\''" : one);
    }
    rowtext_put(line, "'");
}

void shellword_begin(rowtext *line, const char *command, const char *file)
{
    rowtext_clear(line);
    rowtext_put(line, command);
    rowtext_put(line, " ");
    shellword_put(line, file);
}

bool shellword_take(rowtext *word, const char **line)
{
    const char *at = *line + strspn(*line, " ");
    bool quoted = false;
    rowtext_clear(word);
    if (*at == '\0')
        return false;
    for (; *at && (quoted || *at != ' '); at++) {
        if (*at == '\'') {
            quoted = !quoted;
            continue;
        }
        at += !quoted && *at == '\\' && at[1];
        (void)buffer_append(&word->bytes, at, 1);
    }
    (void)buffer_append(&word->bytes, "", 1);
    *line = at;
    return !quoted;
}
