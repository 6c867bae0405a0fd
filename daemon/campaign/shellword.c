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
