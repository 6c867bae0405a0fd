/* SPDX-License-Identifier: MIT
 *
 * shellword.c - writes a command line that a shell reads as it was.
 */
#include "campaign/shellword.h"

#include <string.h>

static const char harmless[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                               "_-./:=,+@%";

void shellword_put(buffer *line, const char *word)
{
    if (*word && word[strspn(word, harmless)] == '\0') {
        buffer_put(line, word);
        return;
    }
    buffer_put(line, "'");
    for (const char *at = word; *at; at++) {
        const char one[] = {*at, '\0'};
        buffer_put(line, *at == '\'' ? "'\\''" : one);
    }
    buffer_put(line, "'");
}

void shellword_begin(buffer *line, const char *command, const char *file)
{
    buffer_clear(line);
    buffer_put(line, command);
    buffer_put(line, " ");
    shellword_put(line, file);
}

bool shellword_take(buffer *word, const char **line)
{
    const char *at = *line + strspn(*line, " ");
    bool quoted = false;
    buffer_clear(word);
    if (*at == '\0')
        return false;
    for (; *at && (quoted || *at != ' '); at++) {
        if (*at == '\'') {
            quoted = !quoted;
            continue;
        }
        at += !quoted && *at == '\\' && at[1];
        (void)buffer_append(word, at, 1);
    }
    (void)buffer_text(word);
    *line = at;
    return !quoted;
}
