/* SPDX-License-Identifier: MIT
 *
 * campaigns.h - campaigns for unit tests, out of texts.
 */
#ifndef CANWIRE_TEST_CAMPAIGNS_H
#define CANWIRE_TEST_CAMPAIGNS_H

#include "campaign/campaign.h"

#include <string.h>
#include <unistd.h>

/* Loads a text; the caller frees the campaign. */
static inline campaign *load_campaign(const char *text)
{
    char path[] = "/tmp/canwire-campaign-XXXXXX";
    int fd = mkstemp(path);
    assert_int_equal(write(fd, text, strlen(text)), strlen(text));
    close(fd);
    campaign *c = campaign_load(path, stderr);
    unlink(path);
    assert_non_null(c);
    return c;
}

/* A scenario inside of a campaign; factors follow. */
#define CAMPAIGN_HEAD                                                                              \
    "scenario:\n"                                                                                  \
    "  bus: { name: b, bitrate: 500000 } # a comment\n"                                            \
    "  nodes:\n"                                                                                   \
    "    - { name: engine, traffic: [ { send: 123#11, every: 1ms, count: 2 } ] }\n"                \
    "    - name: dash\n"                                                                           \
    "  faults:\n"                                                                                  \
    "    - { name: one, when: { frame: 123, count: 1 }, do: { flip: \"crc[3]\", at: dash } }\n"    \
    "    - { name: two, when: { frame: 123, skip: 1 }, do: { flip: \"crc[4]\", at: dash } }\n"     \
    "vary:\n"

#endif
