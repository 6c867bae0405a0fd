/* SPDX-License-Identifier: MIT
 *
 * test_lengths.c - remembered lengths of frames are those that are measured.
 */
#include "rig.h"

#include "format/bits.h"
#include "format/lengths.h"

#define FRAMES 3000u /* more than are remembered */
#define RECENT 8u

/* Most frames have bytes that are not sent, too. */
static cw_frame any_frame(rig_random *random)
{
    cw_frame f = rig_random_frame(random);
    for (unsigned i = 0; i < CW_CLASSICAL_DATA_MAX; i++)
        f.data[i] = (uint8_t)rig_next(random);
    return f;
}

TEST(remembered_lengths_are_those_that_are_measured)
{
    static cw_frame frames[FRAMES];
    static cw_lengths lengths;
    rig_random random = {.state = 1};
    cw_lengths_clear(&lengths);
    for (unsigned i = 0; i < FRAMES; i++) {
        frames[i] = any_frame(&random);
        for (unsigned k = i < RECENT ? 0 : i - RECENT; k <= i; k++)
            assert_int_equal(cw_lengths_of(&lengths, &frames[k]),
                             cw_bits_measure_classical(&frames[k]));
    }
}

TEST(frames_that_differ_in_one_part_are_not_mixed_up)
{
    static cw_lengths lengths;
    const cw_frame frames[] = {
        {.id = 0}, {.id = 1}, {.id = 0, .dlc = 1}, {.id = 0, .flags = CW_FRAME_REMOTE},
        {.id = 0, .flags = CW_FRAME_EXTENDED}, {.id = 0, .dlc = 8, .data = {[7] = 1}},
        {.id = 0, .dlc = 8, .data = {[0] = 0x80}}, {.id = 0, .dlc = 15},
    };
    cw_lengths_clear(&lengths);
    for (unsigned turn = 0; turn < 2; turn++)
        for (unsigned i = 0; i < sizeof frames / sizeof frames[0]; i++)
            assert_int_equal(cw_lengths_of(&lengths, &frames[i]),
                             cw_bits_measure_classical(&frames[i]));
}

/* A frame that comes again is found, though others have been in its place meanwhile. */
TEST(a_frame_stays_until_two_others_take_its_place)
{
    static cw_lengths lengths;
    const cw_frame frame = {.id = 0x123, .dlc = 2, .data = {1, 2}};
    cw_lengths_clear(&lengths);
    const unsigned bits = cw_lengths_of(&lengths, &frame);
    cw_known_length *own = lengths.known;
    while (own->head == UINT64_MAX)
        own++;
    own->head += UINT64_C(1) << CW_LENGTH_AT; /* nobody else would say so */
    assert_int_equal(cw_lengths_of(&lengths, &frame), bits + 1);
    (void)cw_lengths_learn(own, &(cw_frame){.id = 1}, 1, 0);
    assert_int_equal(cw_lengths_of(&lengths, &frame), bits + 1);
    (void)cw_lengths_learn(own, &(cw_frame){.id = 2}, 2, 0);
    assert_int_equal(cw_lengths_of(&lengths, &frame), bits);
}
