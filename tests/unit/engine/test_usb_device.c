/* SPDX-License-Identifier: MIT
 *
 * test_usb_device.c - the emulated adapter between requests of USB/IP and messages of the node.
 */
#include "rig.h"

#include "usb/device.h"
#include "usb/serve.h"

#include <arpa/inet.h>
#include <errno.h>
#include <linux/can/error.h>
#include <sys/socket.h>
#include <unistd.h>

#define HEAD_BYTES 48u
#define COMMANDS 1u
#define FRAMES 2u
#define CHUNK 16u

typedef struct heard {
    usb_device device;
    unsigned frames;
    uint32_t number;
    peak_frame frame;
    unsigned orders;
    message_order order;
    char settings[MESSAGE_SETTINGS_BYTES];
} heard;

typedef struct reply {
    uint32_t command;
    uint32_t number;
    int status;
    uint32_t length;
} reply;

static void on_send(void *user, uint32_t number, const peak_frame *frame)
{
    heard *h = user;
    h->frames++;
    h->number = number;
    h->frame = *frame;
}

static void on_order(void *user, message_order order, const char *settings)
{
    heard *h = user;
    h->orders++;
    h->order = order;
    snprintf(h->settings, sizeof h->settings, "%s", settings);
}

static int set_up(void **state)
{
    static const device_calls calls = {.send = on_send, .order = on_order};
    static const usb_identity who = {.serial = "engine.can0", .number = 7};
    heard *h = calloc(1, sizeof *h);
    device_init(&h->device, &who, &calls, h);
    device_begin(&h->device, true);
    *state = h;
    return 0;
}

static int tear_down(void **state)
{
    heard *h = *state;
    device_free(&h->device);
    free(h);
    return 0;
}

/* ---- The kernel ------------------------------------------------------------------------------ */

/* Sends a request in small pieces: a stream has no bounds. */
static void request(heard *h, const uint32_t words[7], const unsigned char setup[8],
                    const void *data, size_t size)
{
    unsigned char bytes[HEAD_BYTES + 1024] = {0};
    for (unsigned i = 0; i < 7; i++) {
        const uint32_t word = htonl(words[i]);
        memcpy(bytes + 4 * i, &word, sizeof word);
    }
    if (setup)
        memcpy(bytes + 40, setup, 8);
    if (size > 0)
        memcpy(bytes + HEAD_BYTES, data, size);
    for (size_t at = 0; at < HEAD_BYTES + size; at += CHUNK) {
        const size_t left = HEAD_BYTES + size - at;
        assert_true(device_take(&h->device, bytes + at, left < CHUNK ? left : CHUNK));
    }
}

static void submit(heard *h, uint32_t number, bool reads, unsigned endpoint, uint32_t length,
                   const void *data)
{
    const uint32_t words[] = {1, number, 1, reads, endpoint, 0, length};
    request(h, words, NULL, data, reads ? 0 : length);
}

static void control(heard *h, uint32_t number, const unsigned char setup[8], uint32_t length)
{
    const uint32_t words[] = {1, number, 1, setup[0] >> 7, 0, 0, length};
    request(h, words, setup, "\0\1\0\0\0\0\0\0\0\0\0\0\0\0\0\0", setup[0] >> 7 ? 0 : length);
}

static void unlink_of(heard *h, uint32_t number, uint32_t victim)
{
    const uint32_t words[] = {2, number, 1, 0, 0, victim, 0};
    request(h, words, NULL, NULL, 0);
}

/* Takes an answer, with its data. */
static reply take(heard *h, unsigned char *data)
{
    uint32_t words[HEAD_BYTES / 4];
    assert_true(buffer_length(&h->device.out) >= HEAD_BYTES);
    memcpy(words, buffer_first(&h->device.out), sizeof words);
    buffer_take(&h->device.out, HEAD_BYTES);
    const reply r = {.command = ntohl(words[0]),
                     .number = ntohl(words[1]),
                     .status = (int)ntohl(words[5]),
                     .length = ntohl(words[6])};
    if (data && r.length > 0) {
        memcpy(data, buffer_first(&h->device.out), r.length);
        buffer_take(&h->device.out, r.length);
    }
    return r;
}

static void expect(heard *h, uint32_t command, uint32_t number, int status, uint32_t length)
{
    const reply r = take(h, NULL);
    assert_int_equal(r.command, command);
    assert_int_equal(r.number, number);
    assert_int_equal(r.status, status);
    assert_int_equal(r.length, length);
}

static void expect_nothing(const heard *h)
{
    assert_int_equal(buffer_length(&h->device.out), 0);
}

static void command(heard *h, uint32_t number, const unsigned char *bytes, uint32_t size)
{
    submit(h, number, false, COMMANDS, size, bytes);
    expect(h, 3, number, 0, size);
}

/* The commands of `ip link set can0 type can bitrate 500000` and of `up`. */
static const unsigned char timing[] = {0x04, 0, 96, 0, 19, 138, 0, 0,
                                       255,  255, 255, 255, 255, 255, 255, 255};
static const unsigned char data_timing[] = {0x05, 0, 0, 3, 9, 29, 1, 0};
static const unsigned char normal[] = {0x0a, 0, 0, 0xc0, 0, 0, 0, 0, 0x0b, 0, 4, 0, 0, 0, 0, 0,
                                       0x02, 0, 0, 0,    0, 0, 0, 0, 255, 255, 255, 255, 255, 255,
                                       255,  255};
static const unsigned char off[] = {0x01, 0, 0, 0, 0, 0, 0, 0, 255, 255, 255, 255, 255, 255, 255,
                                    255};

static void go_on(heard *h)
{
    command(h, 1, timing, sizeof timing);
    command(h, 2, normal, sizeof normal);
    assert_int_equal(h->order, MESSAGE_ON);
}

/* A classical frame 123#1122, and the null behind it. */
static const unsigned char frame_123[] = {24, 0, 0, 0x10, 0, 0, 0, 0, 0, 0, 0,    0,    0x20, 0,
                                          0,  0, 0x23, 1, 0, 0, 0x11, 0x22, 0, 0, 0, 0, 0, 0};

static void send_frame(heard *h, uint32_t number)
{
    submit(h, number, false, FRAMES, sizeof frame_123, frame_123);
}

/* ---- Tests ----------------------------------------------------------------------------------- */

TEST_WITH(it_says_who_it_is, set_up, tear_down)
{
    heard *h = *state;
    unsigned char data[256];
    static const unsigned char get_device[] = {0x80, 6, 0, 1, 0, 0, 64, 0};
    static const unsigned char get_serial[] = {0x80, 6, 3, 3, 9, 4, 255, 0};
    static const unsigned char get_bos[] = {0x80, 6, 0, 15, 0, 0, 5, 0};
    static const unsigned char get_firmware[] = {0xc3, 0, 1, 0, 0, 0, 36, 0};
    static const unsigned char loaded[] = {0x43, 2, 5, 0, 0, 0, 16, 0};
    control(h, 1, get_device, 64);
    assert_int_equal(take(h, data).length, 18);
    assert_memory_equal(data + 8, "\x72\x0c\x12\x00", 4);
    control(h, 2, get_device, 8);
    assert_int_equal(take(h, data).length, 8);
    control(h, 3, get_serial, 255);
    assert_int_equal(take(h, data).length, 2 + 2 * strlen("engine.can0"));
    assert_memory_equal(data + 2, "e\0n\0g\0", 6);
    control(h, 4, get_bos, 5);
    expect(h, 3, 4, -EPIPE, 0);
    control(h, 5, get_firmware, 36);
    assert_int_equal(take(h, data).length, 36);
    assert_int_equal(data[0], 36);
    assert_int_equal(data[28], 1); /* the endpoint of commands */
    assert_int_equal(data[20], 7);
    assert_false(h->device.claimed);
    control(h, 6, loaded, 16);
    expect(h, 3, 6, 0, 16);
    assert_true(h->device.claimed);
    expect_nothing(h);
}

TEST_WITH(a_driver_that_goes_has_not_come, set_up, tear_down)
{
    heard *h = *state;
    static const unsigned char loaded[] = {0x43, 2, 5, 0, 0, 0, 16, 0};
    static const unsigned char lamp[] = {0x43, 2, 4, 0, 0, 0, 16, 0};
    const uint32_t words[] = {1, 1, 1, 0, 0, 0, 16};
    request(h, words, loaded, "\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0", 16);
    expect(h, 3, 1, 0, 16);
    control(h, 2, lamp, 16);
    expect(h, 3, 2, 0, 16);
    assert_false(h->device.claimed);
}

/* The driver makes its interface when it has its answer. All goes through one socket here. */
TEST(the_sign_of_a_driver_comes_before_its_answer)
{
    static const usb_identity who = {.serial = "engine.can0"};
    static const unsigned char claim[HEAD_BYTES + 16] = {
        [3] = 1, [7] = 1, [27] = 16, [40] = 0x43, [41] = 2, [42] = 5, [46] = 16, [49] = 1};
    unsigned char got[256];
    int ends[2];
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, ends), 0);
    assert_int_equal(write(ends[0], claim, sizeof claim), sizeof claim);
    assert_int_equal(shutdown(ends[0], SHUT_WR), 0);
    assert_int_equal(serve(ends[1], ends[1], &who, "/nowhere"), SERVE_UNPLUGGED);
    assert_int_equal(close(ends[1]), 0);
    assert_int_equal(recv(ends[0], got, sizeof got, MSG_DONTWAIT), 2 + HEAD_BYTES);
    assert_memory_equal(got, ((const char[]){SERVE_ALIVE, SERVE_CLAIMED, 0, 0, 0, 3}), 6);
    assert_int_equal(close(ends[0]), 0);
}

TEST_WITH(the_node_gets_the_timing_when_it_goes_on, set_up, tear_down)
{
    heard *h = *state;
    command(h, 1, timing, sizeof timing);
    assert_int_equal(h->orders, 0);
    command(h, 2, data_timing, sizeof data_timing); /* full of commands: no end */
    command(h, 3, normal, sizeof normal);
    assert_int_equal(h->order, MESSAGE_ON);
    assert_string_equal(h->settings,
                        "{\"clock\":\"80MHz\",\"brp\":1,\"prop-seg\":119,\"phase-seg1\":20,"
                        "\"phase-seg2\":20,\"sjw\":1,\"dbrp\":2,\"dprop-seg\":20,"
                        "\"dphase-seg1\":10,\"dphase-seg2\":10,\"dsjw\":4,"
                        "\"triple-sampling\":false,\"listen-only\":false,\"one-shot\":false,"
                        "\"restart-ms\":0}");
    command(h, 4, off, sizeof off);
    assert_int_equal(h->order, MESSAGE_OFF);
    device_begin(&h->device, false); /* a node that knows no CAN FD; it stays off */
    assert_int_equal(h->orders, 2);
    command(h, 5, normal, sizeof normal);
    assert_null(strstr(h->settings, "dbrp"));
}

TEST_WITH(a_frame_is_answered_when_the_bus_has_sent_it, set_up, tear_down)
{
    heard *h = *state;
    send_frame(h, 10);
    expect(h, 3, 10, -EPROTO, 0); /* it is off */
    go_on(h);
    send_frame(h, 11);
    expect_nothing(h);
    assert_int_equal(h->number, 11);
    assert_int_equal(h->frame.size, CAN_MTU);
    assert_int_equal(h->frame.classical.can_id, 0x123);
    assert_int_equal(h->frame.classical.len, 2);
    assert_memory_equal(h->frame.classical.data, "\x11\x22", 2);
    device_was_sent(&h->device, 12); /* of an earlier life */
    expect_nothing(h);
    device_was_sent(&h->device, 11);
    expect(h, 3, 11, 0, sizeof frame_123);
    send_frame(h, 13);
    device_was_dropped(&h->device, 13);
    expect(h, 3, 13, -EPROTO, 0);
}

TEST_WITH(after_ten_failures_the_driver_gets_its_queue_back, set_up, tear_down)
{
    heard *h = *state;
    go_on(h);
    for (uint32_t i = 0; i < 10; i++)
        send_frame(h, 20 + i);
    for (uint32_t i = 0; i < 9; i++) {
        device_was_dropped(&h->device, 20 + i);
        expect(h, 3, 20 + i, -EPROTO, 0);
    }
    device_was_dropped(&h->device, 29);
    expect(h, 3, 29, 0, sizeof frame_123); /* only a success wakes the driver's queue */
    send_frame(h, 30);
    device_was_dropped(&h->device, 30);
    expect(h, 3, 30, -EPROTO, 0);
}

TEST_WITH(a_request_can_be_taken_back, set_up, tear_down)
{
    heard *h = *state;
    go_on(h);
    send_frame(h, 10);
    submit(h, 11, true, FRAMES, 2048, NULL);
    submit(h, 12, true, COMMANDS, 64, NULL);
    expect_nothing(h);
    unlink_of(h, 13, 10);
    expect(h, 4, 13, -ECONNRESET, 0);
    unlink_of(h, 14, 12);
    expect(h, 4, 14, -ECONNRESET, 0);
    unlink_of(h, 15, 12);
    expect(h, 4, 15, 0, 0);
    device_was_sent(&h->device, 10);
    expect_nothing(h);
}

TEST_WITH(one_shot_is_a_mode_of_the_frames, set_up, tear_down)
{
    heard *h = *state;
    unsigned char once[sizeof frame_123];
    memcpy(once, frame_123, sizeof once);
    once[14] = 0x08;
    go_on(h);
    submit(h, 10, false, FRAMES, sizeof once, once);
    assert_int_equal(h->order, MESSAGE_SET);
    assert_string_equal(h->settings, "{\"one-shot\":true}");
    submit(h, 11, false, FRAMES, sizeof once, once);
    assert_int_equal(h->orders, 2);
}

TEST_WITH(frames_share_a_request_to_read, set_up, tear_down)
{
    heard *h = *state;
    unsigned char data[2048];
    const struct can_frame frame = {.can_id = 0x80000456, .len = 3, .data = {1, 2, 3}};
    const struct canfd_frame fd = {.can_id = 0x7ff, .len = 64, .flags = CANFD_FDF | CANFD_BRS};
    device_received(&h->device, &frame, sizeof frame, 5); /* off: nobody gets it */
    go_on(h);
    device_received(&h->device, &frame, sizeof frame, UINT64_C(0x500000006));
    device_received(&h->device, &fd, sizeof fd, 7);
    device_received(&h->device, &frame, sizeof frame, 8);
    submit(h, 10, true, FRAMES, 36 + 92, NULL);
    assert_int_equal(take(h, data).length, 36 + 92); /* not the third one */
    static const unsigned char first[] = {36, 0, 1, 0, 6, 0, 0, 0, 5, 0, 0, 0};
    assert_memory_equal(data, first, sizeof first);
    assert_int_equal(data[20], 0x30);
    assert_int_equal(data[22], 0x02);
    assert_memory_equal(data + 24, "\x56\x04\0\0\1\2\3", 7);
    assert_int_equal(data[36 + 20], 0xf0);
    assert_int_equal(data[36 + 22], 0x30);
    submit(h, 11, true, FRAMES, 2048, NULL);
    assert_int_equal(take(h, data).length, 36);
}

TEST_WITH(what_comes_together_waits_for_the_end_of_a_frame_at_most, set_up, tear_down)
{
    heard *h = *state;
    const struct can_frame frame = {.can_id = 0x456, .len = 3, .data = {1, 2, 3}};
    go_on(h);
    send_frame(h, 10);
    submit(h, 11, true, FRAMES, 2048, NULL);
    submit(h, 12, true, FRAMES, 2048, NULL);
    device_received(&h->device, &frame, sizeof frame, 5);
    device_received(&h->device, &frame, sizeof frame, 6);
    expect_nothing(h);
    device_was_sent(&h->device, 10);
    unsigned char data[2048];
    const reply both = take(h, data);
    assert_int_equal(both.number, 11);
    assert_int_equal(both.length, 2 * 36);
    expect(h, 3, 10, 0, sizeof frame_123);
    device_received(&h->device, &frame, sizeof frame, 7);
    device_state(&h->device, &(message_state){.state = 0, .rec = 1}, 8);
    expect_nothing(h);
    device_flush(&h->device);
    assert_int_equal(take(h, data).length, 36 + 16);
    expect_nothing(h);
}

TEST_WITH(states_come_with_their_counters, set_up, tear_down)
{
    heard *h = *state;
    unsigned char data[2048];
    go_on(h);
    device_state(&h->device, &(message_state){.state = 0, .tec = 8}, 1);
    device_state(&h->device, &(message_state){.state = 2, .tec = 128, .rec = 3}, 2);
    submit(h, 10, true, FRAMES, 2048, NULL);
    assert_int_equal(take(h, data).length, 4 * 16);
    assert_int_equal(data[2], 2);
    assert_int_equal(data[14], 8);
    assert_int_equal(data[16 + 2], 2);
    assert_memory_equal(data + 16 + 14, "\x80\x03", 2);
    assert_int_equal(data[32 + 2], 3);
    assert_int_equal(data[32 + 12], 0x60);
    assert_int_equal(data[48 + 2], 2);
    device_state(&h->device, &(message_state){.state = 3, .tec = 256}, 3);
    submit(h, 11, true, FRAMES, 2048, NULL);
    assert_int_equal(take(h, data).length, 3 * 16);
    assert_int_equal(data[14], 255);
    assert_int_equal(data[16 + 12], 0x80);
}

/* The second order to go on is the driver's restart. It has forgotten its frames by then. */
TEST_WITH(a_restart_ends_what_was_under_way, set_up, tear_down)
{
    heard *h = *state;
    go_on(h);
    send_frame(h, 10);
    submit(h, 11, false, COMMANDS, sizeof normal, normal);
    expect(h, 3, 10, -EPROTO, 0);
    expect(h, 3, 11, 0, sizeof normal);
    assert_int_equal(h->order, MESSAGE_RESTART);
}

TEST_WITH(error_frames_without_what_the_driver_makes, set_up, tear_down)
{
    heard *h = *state;
    unsigned char data[2048];
    const struct can_frame state_frame = {.can_id = CAN_ERR_FLAG | CAN_ERR_CRTL, .len = 8};
    const struct can_frame bus_error = {
        .can_id = CAN_ERR_FLAG | CAN_ERR_CRTL | CAN_ERR_PROT | CAN_ERR_BUSERROR, .len = 8};
    go_on(h);
    device_received(&h->device, &state_frame, sizeof state_frame, 1);
    device_received(&h->device, &bus_error, sizeof bus_error, 2);
    submit(h, 10, true, FRAMES, 2048, NULL);
    assert_int_equal(take(h, data).length, 36);
    assert_memory_equal(data + 24, "\x88\0\0\x20", 4);
    assert_int_equal(data[22], 0);
}

/* canwired has come back: the node gets all of it again. */
TEST_WITH(a_new_connection_gets_all_again, set_up, tear_down)
{
    heard *h = *state;
    go_on(h);
    send_frame(h, 10);
    device_begin(&h->device, true);
    assert_int_equal(h->order, MESSAGE_ON);
    assert_int_equal(h->frames, 2);
    assert_int_equal(h->number, 10);
}

TEST_WITH(broken_requests_end_it, set_up, tear_down)
{
    heard *h = *state;
    static const unsigned char broken[] = {255, 0, 0, 0x10, 1, 2, 3, 4, 5, 6, 7, 8,
                                           9,   0, 1, 2,    3, 4, 5, 6, 7, 8, 9, 0};
    go_on(h);
    submit(h, 10, false, FRAMES, sizeof broken, broken);
    expect(h, 3, 10, -EPROTO, 0);
    submit(h, 11, false, 9, 4, "abcd");
    expect(h, 3, 11, -EPIPE, 0);
    const uint32_t huge[HEAD_BYTES / 4] = {htonl(1), 0, 0, 0, 0, 0, htonl(1 << 20)};
    assert_false(device_take(&h->device, huge, sizeof huge));
}

/* Requests of the kernel with content that no driver sends; sanitizers look on. */
TEST_WITH(any_content_is_survived, set_up, tear_down)
{
    heard *h = *state;
    uint32_t random = 1;
    unsigned char data[96];
    for (uint32_t number = 1; number < 5000; number++) {
        for (unsigned i = 0; i < sizeof data; i++) {
            random = random * 1664525u + 1013904223u;
            data[i] = (unsigned char)(random >> 24);
        }
        data[2] = number % 3 ? data[2] : 0; /* often the type of a frame, and a size that fits */
        data[3] = number % 3 ? data[3] : 0x10;
        data[1] = number % 2 ? data[1] : 0;
        if (number % 7 == 0)
            submit(h, number, false, COMMANDS, sizeof normal, normal);
        else if (number % 5 == 0)
            control(h, number, data, data[9] % 17);
        else if (number % 11 == 0)
            unlink_of(h, number, number - data[0] % 16);
        else
            submit(h, number, data[95] & 1, data[94] % 4, data[93] % sizeof data, data);
        device_received(&h->device, data, data[92] & 1 ? CAN_MTU : CANFD_MTU, number);
        device_was_dropped(&h->device, number - data[91] % 8);
        if (number % 3 == 0)
            device_flush(&h->device);
        buffer_take(&h->device.out, buffer_length(&h->device.out));
    }
    assert_true(h->frames > 0 && h->orders > 0);
}
