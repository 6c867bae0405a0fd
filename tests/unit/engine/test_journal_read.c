/* SPDX-License-Identifier: MIT
 *
 * test_journal_read.c - journals that are wrong are refused, with the place of what is wrong.
 */
#include "cases.h"
#include "journal_rig.h"

#define HEADER "{\"canwire-journal\":1,\"canwire\":\"x\"}\n"
#define CONFIG                                                                                     \
    "{\"at\":0,\"config\":[{\"name\":\"c\",\"text\":\"{bus: {bitrate: 500000}, nodes: [{name: a}," \
    " {name: b}], faults: [{name: r, when: {manual: yes}, do: {bus-off: a}}]}\"}]}\n"

typedef struct bad_journal {
    const char *text;
    const char *message; /* behind the name of the file; a part of it */
} bad_journal;

static const bad_journal bad_journals[] = {
    {"", ":1:1: this is no journal"},
    {"bus: { bitrate: 500000 }\n", ":1:"},
    {"{}\n", ":1:1: this is no journal"},
    {"[]\n", ":1:1: expected an object"},
    {"{\"canwire-journal\":5,\"canwire\":\"x\"}\n",
     ":1:20: version 5 of journals is not known, only 1 to 4"},
    {"{\"canwire-journal\":4,\"canwire\":\"x\"}\n", ":1:1: damaged: no checksum, bytes 0 to 35"},
    {"{\"canwire-journal\":3,\"canwire\":\"x\"}\n",
     ":1:1: buses: expected a whole number from 0 to 16"},
    {"{\"canwire-journal\":3,\"canwire\":\"x\",\"buses\":0}\n",
     ":1:44: buses: expected a whole number from 1 to 16"},
    {HEADER, ":2:1: a journal begins with a configuration"},
    {HEADER END, ":2:1: a journal begins with a configuration"},
    {HEADER "{\"at\":0,\"config\":[]}\n", ":2:18: config: expected 1 to 200 files"},
    {HEADER "{\"at\":0,\"config\":[{\"name\":\"c\"}]}\n",
     ":2:18: config: expected a list of files"},
    {HEADER "{\"at\":0,\"config\":[{\"name\":\"c\",\"text\":\"x: 1\"}]}\n",
     "c:1:1: configuration:"},
    {HEADER "{\"at\":0,\"config\":[{\"name\":\"c\",\"text\":{\"hex\":\"4\"}}]}\n",
     ":2:18: config: hex: expected pairs"},
    {HEADER "{\"at\":0,\"config\":[{\"name\":\"\",\"text\":\"\"}]}\n",
     ":2:18: config: expected a text that is not empty"},
    {HEADER CONFIG "\n", ":3:"},
    {HEADER CONFIG "{\"at\":0\n", ":3:7: "},
    {HEADER CONFIG "{\"at\":0,\"at\":0}\n", ":3:12: duplicate object key"},
    {HEADER CONFIG "{\"send\":\"a\"}\n", ":3:1: the key 'at' is missing"},
    {HEADER CONFIG "{\"at\":-160,\"fire\":\"r\"}\n", ":3:7: at: expected a whole number"},
    {HEADER CONFIG "{\"at\":1.5,\"fire\":\"r\"}\n", ":3:7: at: expected a whole number"},
    {HEADER CONFIG "{\"at\":161,\"fire\":\"r\"}\n", ":3:7: at: not the end of a bit"},
    {HEADER CONFIG "{\"at\":160,\"skip\":1,\"earlier\":0}\n{\"at\":0,\"skip\":1,\"earlier\":1}\n",
     ":4:7: at: before the line above"},
    {HEADER CONFIG "{\"at\":0}\n", ":3:1: this is no line of a journal"},
    {HEADER CONFIG "{\"at\":0,\"sned\":\"a\"}\n",
     ":3:16: this is no line of a journal (did you mean 'send'?)"},
    {HEADER CONFIG "{\"at\":0,\"fire\":1}\n", ":3:16: fire: expected a text"},
    {HEADER CONFIG "{\"at\":0,\"fire\":\"x\"}\n", ":3:16: there is no rule 'x'"},
    {HEADER CONFIG "{\"at\":0,\"clear\":\"x\"}\n", ":3:17: there is no rule 'x'"},
    {HEADER CONFIG "{\"at\":0,\"fire\":\"r\",\"why\":1}\n", ":3:26: fire: there is no key 'why'"},
    {HEADER CONFIG "{\"at\":0,\"again\":false,\"fire\":\"r\"}\n", ":3:17: again: expected true"},
    {HEADER "{\"at\":0,\"again\":true,\"config\":[]}\n", ":2:17: config: there is no key 'again'"},
    {HEADER CONFIG "{\"at\":0,\"send\":\"z\",\"frame\":\"123#\",\"tick\":0}\n",
     ":3:16: there is no node 'z'"},
    {HEADER CONFIG "{\"at\":0,\"send\":\"a\",\"frame\":\"123#\"}\n",
     ":3:1: send: the key 'tick' is missing"},
    {HEADER CONFIG "{\"at\":0,\"send\":\"a\",\"frame\":\"12#\",\"tick\":0}\n", ":3:28: frame: "},
    {HEADER CONFIG "{\"at\":0,\"send\":\"a\",\"tick\":0}\n", ":3:1: send: expected either frame"},
    {HEADER CONFIG "{\"at\":0,\"send\":\"a\",\"tick\":0,\"frame\":\"123#\",\"id\":1}\n",
     ":3:37: send: expected either frame"},
    {HEADER CONFIG
     "{\"at\":0,\"send\":\"a\",\"tick\":0,\"id\":1,\"flags\":32,\"dlc\":0,\"data\":\"\"}\n",
     ":3:44: flags: expected a whole number from 0 to 31"},
    {HEADER CONFIG
     "{\"at\":0,\"send\":\"a\",\"tick\":0,\"id\":1,\"flags\":0,\"dlc\":0,\"data\":\"00\"}\n",
     ":3:61: data: expected 8 bytes"},
    {HEADER CONFIG
     "{\"at\":0,\"send\":\"a\",\"tick\":0,\"id\":1,\"flags\":4,\"dlc\":0,\"data\":\"00\"}\n",
     ":3:61: data: expected 64 bytes"},
    {HEADER CONFIG
     "{\"at\":0,\"send\":\"a\",\"tick\":0,\"id\":1,\"flags\":4,\"dlc\":0,"
     "\"data\":\"0000000000000000\"}\n{\"at\":0,\"fire\":\"x\"}\n",
     ":4:16: there is no rule 'x'"},
    {HEADER CONFIG "{\"at\":0,\"send\":\"a\",\"frame\":\"123##\",\"tick\":0}\n",
     ":3:28: frame: expected a CAN FD frame"},
    {HEADER CONFIG "{\"at\":0,\"set\":\"a\",\"settings\":{\"queue\":0}}\n",
     ":3:30: settings: queue: "},
    {HEADER CONFIG "{\"at\":0,\"set\":\"a\"}\n", ":3:1: set: the key 'settings' is missing"},
    {HEADER CONFIG "{\"at\":0,\"attach\":\"z\"}\n", ":3:18: there is no node 'z'"},
    {HEADER CONFIG "{\"at\":0,\"detach\":\"z\"}\n", ":3:18: there is no node 'z'"},
    {HEADER CONFIG "{\"at\":0,\"restart\":\"z\"}\n", ":3:19: there is no node 'z'"},
    {HEADER CONFIG "{\"at\":0,\"inject\":7,\"name\":\"x\"}\n", ":3:18: inject: expected a text or"},
    {HEADER CONFIG "{\"at\":0,\"reload\":[{\"name\":\"c\",\"text\":\"\"}]}\n",
     "c:1:1: the file is empty"},
    {HEADER CONFIG "{\"at\":0,\"reload\":[{\"name\":\"c\",\"text\":\"{bus: {bitrate: 250000},"
                   " nodes: [{name: a}]}\"}]}\n",
     ":3:18: the bus cannot go over to it"},
    {HEADER CONFIG CONFIG, ":3:18: there is a second configuration"},
    {HEADER CONFIG "{\"at\":0,\"mark\":{}}\n", ":3:16: mark: expected a whole number at 'frames'"},
    /* another run */
    {HEADER CONFIG "{\"at\":0,\"restart\":\"a\"}\n" END,
     ":3:19: this run is another one than that of the journal: the bus refuses what it did then; "
     "it was written by canwire x\n"},
    {HEADER CONFIG "{\"at\":0,\"inject\":\"nonsense\",\"name\":\"x\"}\n" END,
     ":3:18: this run is another one than that of the journal: the bus does not take these rules"},
    {HEADER CONFIG "{\"at\":1600,\"mark\":" COUNTERS("1") "}\n" END,
     ":3:19: this run is another one than that of the journal: frames is 0 and was 1"},
};

TEST(bad_journals_are_refused_with_their_place)
{
    for (size_t i = 0; i < COUNT(bad_journals); i++) {
        const bad_journal *bad = &bad_journals[i];
        FREED char *events;
        FREED char *messages;
        write_file("journal", bad->text);
        journal_outcome outcome = play(&events, &messages);
        const char *said = messages;
        if (bad->message[0] == ':' && strncmp(said, path_of("journal"), strlen(path_of(""))) == 0)
            said += strlen(path_of("journal"));
        if (outcome != JOURNAL_FAILED || strncmp(said, bad->message, strlen(bad->message)) != 0)
            fail_msg("%s\nexpected %s\ngot %d %s", bad->text, bad->message, (int)outcome, messages);
    }
}

TEST(a_broken_journal_says_so)
{
    FREED char *events;
    FREED char *messages;
    write_file("journal",
               HEADER CONFIG "{\"at\":0,\"fire\":\"r\"}\n{\"at\":1600,\"broken\":true}\n");
    assert_int_equal(play(&events, &messages), JOURNAL_INCOMPLETE);
    assert_non_null(strstr(messages, "the journal is broken at 0.000020000 s (line 4, byte "));
    assert_non_null(strstr(events, "\"state\":\"bus-off\""));
}

TEST(a_good_journal_has_nothing_to_say)
{
    FREED char *events;
    FREED char *messages;
    write_file("journal", HEADER CONFIG END);
    assert_int_equal(play(&events, &messages), JOURNAL_PLAYED);
    assert_string_equal(messages, "");
    assert_string_equal(events, "");
}

TESTS_WITH(make_folder, remove_folder)
