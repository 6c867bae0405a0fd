/* SPDX-License-Identifier: MIT
 *
 * test_errframe.c - error frames against linux/can/error.h and what the SJA1000 driver sends.
 *
 * The expected numbers are written out, so that they can be read beside the kernel's header.
 */
#include "cases.h"
#include "trace/errframe.h"

#define ERR 0x20000000u     /* CAN_ERR_FLAG */
#define LOSTARB 0x2u        /* lost arbitration, data[0] */
#define CRTL 0x4u           /* controller, data[1] */
#define PROT 0x8u           /* protocol, data[2..3] */
#define ACK 0x20u
#define BUSOFF 0x40u
#define BUSERROR 0x80u
#define RESTARTED 0x100u
#define CNT 0x200u          /* counters in data[6..7] */

#define BERR_MODE CW_MODE_BERR_REPORTING
#define ALL_MODES (CW_MODE_BERR_REPORTING | CW_MODE_LOST_ARBITRATION_REPORTING)

typedef struct row {
    const char *name;
    cw_event event;
    unsigned mode; /* CW_MODE_* without which there is none, or 0 */
    errframe wanted;
} row;

#define ERROR_EVENT(type_, role_, field_, index_, ...)                                             \
    {                                                                                              \
        .kind = CW_EVENT_ERROR, .tec = 8, .rec = 3,                                                \
        .error = {.type = type_,                                                          \
                  .role = role_,                                                          \
                  .place = {.field = field_, .index = index_, __VA_ARGS__}}               \
    }
#define TX CW_ROLE_TRANSMITTER
#define RX CW_ROLE_RECEIVER
#define BERR (ERR | PROT | BUSERROR | CNT)

/* A row with counters: the type of the error in data[2], with 0x80 for a transmitter, and its
 * location in data[3]. */
#define BUS_ERROR(name, type, role, field, index, kind, location)                                  \
    {                                                                                              \
        name, ERROR_EVENT(CW_ERROR_##type, role, CW_FIELD_##field, index), BERR_MODE,              \
        {BERR, {0, 0, kind, location, 0, 0, 8, 3}}                                                 \
    }

static const row rows[] = {
    /* state changes: the larger counter, both when equal */
    {"warning by tec", {.kind = CW_EVENT_STATE, .state = CW_STATE_ERROR_WARNING, .tec = 96},
     0, {ERR | CRTL | CNT, {0, 0x08, 0, 0, 0, 0, 96, 0}}},
    {"warning by rec", {.kind = CW_EVENT_STATE, .state = CW_STATE_ERROR_WARNING, .rec = 97},
     0, {ERR | CRTL | CNT, {0, 0x04, 0, 0, 0, 0, 0, 97}}},
    {"passive by tec",
     {.kind = CW_EVENT_STATE, .state = CW_STATE_ERROR_PASSIVE, .tec = 128, .rec = 9},
     0, {ERR | CRTL | CNT, {0, 0x20, 0, 0, 0, 0, 128, 9}}},
    {"passive by rec",
     {.kind = CW_EVENT_STATE, .state = CW_STATE_ERROR_PASSIVE, .tec = 1, .rec = 129},
     0, {ERR | CRTL | CNT, {0, 0x10, 0, 0, 0, 0, 1, 129}}},
    {"passive by both",
     {.kind = CW_EVENT_STATE, .state = CW_STATE_ERROR_PASSIVE, .tec = 130, .rec = 130},
     0, {ERR | CRTL | CNT, {0, 0x30, 0, 0, 0, 0, 130, 130}}},
    {"active again", {.kind = CW_EVENT_STATE, .state = CW_STATE_ERROR_ACTIVE, .tec = 95, .rec = 2},
     0, {ERR | CRTL | CNT, {0, 0x40, 0, 0, 0, 0, 95, 2}}},
    {"bus-off has no counters", {.kind = CW_EVENT_STATE, .state = CW_STATE_BUS_OFF, .tec = 256},
     0, {ERR | BUSOFF, {0}}},
    {"restarted", {.kind = CW_EVENT_RESTART}, 0, {ERR | RESTARTED, {0}}},
    {"lost arbitration", {.kind = CW_EVENT_ARBITRATION_LOST, .lost_bit = 12},
     CW_MODE_LOST_ARBITRATION_REPORTING,
     {ERR | LOSTARB, {12}}},
    {"queue full", {.kind = CW_EVENT_DROP, .why = CW_DROP_QUEUE_FULL}, 0,
     {ERR | CRTL, {0, 0x02}}},
    BUS_ERROR("bit sof", BIT, TX, SOF, 0, 0x81, 0x03),
    BUS_ERROR("bit id 28", BIT, TX, ID, 0, 0x81, 0x02),
    BUS_ERROR("stuff id 21", STUFF, RX, ID, 7, 0x04, 0x02),
    BUS_ERROR("stuff id 20", STUFF, RX, ID, 8, 0x04, 0x06),
    BUS_ERROR("stuff id 18", STUFF, RX, ID, 10, 0x04, 0x06),
    BUS_ERROR("stuff id 17", STUFF, RX, ID, 11, 0x04, 0x07),
    BUS_ERROR("stuff id 13", STUFF, RX, ID, 15, 0x04, 0x07),
    BUS_ERROR("stuff id 12", STUFF, RX, ID, 16, 0x04, 0x0F),
    BUS_ERROR("stuff id 5", STUFF, RX, ID, 23, 0x04, 0x0F),
    BUS_ERROR("stuff id 4", STUFF, RX, ID, 24, 0x04, 0x0E),
    BUS_ERROR("srr", STUFF, TX, SRR, 0, 0x84, 0x04),
    BUS_ERROR("base rtr", BIT, TX, RTR, 0, 0x81, 0x04),
    {"extended rtr", ERROR_EVENT(CW_ERROR_BIT, TX, CW_FIELD_RTR, 0, .extended = true),
     BERR_MODE, {BERR, {0, 0, 0x81, 0x0C, 0, 0, 8, 3}}},
    BUS_ERROR("ide", BIT, TX, IDE, 0, 0x81, 0x05),
    BUS_ERROR("r1", BIT, TX, R1, 0, 0x81, 0x0D),
    BUS_ERROR("r0", BIT, TX, R0, 0, 0x81, 0x09),
    BUS_ERROR("fdf", BIT, TX, FDF, 0, 0x81, 0x09),
    BUS_ERROR("res", FORM, RX, RES, 0, 0x02, 0x09),
    BUS_ERROR("brs", BIT, TX, BRS, 0, 0x81, 0x0B),
    BUS_ERROR("esi", BIT, TX, ESI, 0, 0x81, 0x0B),
    BUS_ERROR("dlc", BIT, TX, DLC, 2, 0x81, 0x0B),
    BUS_ERROR("data", BIT, TX, DATA, 63, 0x81, 0x0A),
    BUS_ERROR("crc sequence", BIT, TX, CRC, 14, 0x81, 0x08),
    BUS_ERROR("data of a CAN FD frame", STUFF, RX, DATA, 511, 0x04, 0x0A),
    BUS_ERROR("stuff count", BIT, TX, STUFF_COUNT, 1, 0x81, 0x08),
    BUS_ERROR("fixed stuff bit", FORM, RX, FIXED_STUFF, 6, 0x02, 0x08),
    {"second ack bit", ERROR_EVENT(CW_ERROR_ACK, TX, CW_FIELD_ACK_SLOT, 1),
     BERR_MODE, {BERR | ACK, {0, 0, 0x80, 0x19, 0, 0, 8, 3}}},
    BUS_ERROR("crc error", CRC, RX, ACK_DELIMITER, 0, 0x00, 0x08),
    BUS_ERROR("crc delimiter", FORM, RX, CRC_DELIMITER, 0, 0x02, 0x18),
    {"missing ack", ERROR_EVENT(CW_ERROR_ACK, TX, CW_FIELD_ACK_SLOT, 0),
     BERR_MODE, {BERR | ACK, {0, 0, 0x80, 0x19, 0, 0, 8, 3}}},
    BUS_ERROR("own ack bit", BIT, RX, ACK_SLOT, 0, 0x01, 0x19),
    BUS_ERROR("ack delimiter", FORM, RX, ACK_DELIMITER, 0, 0x02, 0x1B),
    BUS_ERROR("eof", FORM, TX, EOF, 6, 0x82, 0x1A),
    BUS_ERROR("active flag", BIT, RX, ERROR_FLAG, 2, 0x01, 0x11),
    BUS_ERROR("error delimiter", FORM, RX, ERROR_DELIMITER, 3, 0x02, 0x17),
    BUS_ERROR("overload flag", BIT, TX, OVERLOAD_FLAG, 3, 0x81, 0x1C),
    BUS_ERROR("overload delimiter", FORM, RX, OVERLOAD_DELIMITER, 3, 0x02, 0x17),
    {"dominant after flag",
     {.kind = CW_EVENT_TOLERATED, .tec = 8, .rec = 3,
      .error = {.role = RX, .place = {.field = CW_FIELD_ERROR_DELIMITER}}},
     BERR_MODE, {BERR, {0, 0, 0x00, 0x13, 0, 0, 8, 3}}},
    {"dominant in passive flag",
     {.kind = CW_EVENT_TOLERATED, .tec = 136,
      .error = {.role = TX, .place = {.field = CW_FIELD_ERROR_FLAG}}},
     BERR_MODE, {BERR, {0, 0, 0x80, 0x16, 0, 0, 136, 0}}},
};

TEST_ROWS(check_row, rows)
{
    const row *r = *state;
    errframe with;
    errframe without;
    assert_true(errframe_from_event(&with, &r->event, ALL_MODES, ERRFRAME_ANY));
    assert_int_equal(with.can_id, r->wanted.can_id);
    assert_memory_equal(with.data, r->wanted.data, sizeof with.data);
    const unsigned modes = ALL_MODES & ~r->mode;
    assert_int_equal(errframe_from_event(&without, &r->event, modes, ERRFRAME_ANY), r->mode == 0);
}

/* ---- Drivers --------------------------------------------------------------------------------- */

#define STATE(before, after, tec_, rec_)                                                           \
    {                                                                                              \
        .kind = CW_EVENT_STATE, .state_before = CW_STATE_##before, .state = CW_STATE_##after,      \
        .tec = tec_, .rec = rec_                                                                   \
    }
#define FOUND(type_, role_, field_, sent_)                                                         \
    {                                                                                              \
        .kind = CW_EVENT_ERROR, .tec = 8, .rec = 3,                                                \
        .error = {.type = CW_ERROR_##type_, .role = role_, .place = {.field = field_},             \
                  .sent = sent_}                                                                   \
    }
#define NONE {0}

/* An event, and the frames that each driver makes of it with all modes. */
typedef struct driver_row {
    const char *name;
    cw_event event;
    errframe sja1000, mcp251x, m_can, flexcan, bxcan;
} driver_row;

static const driver_row driver_rows[] = {
    {"warning by tec", STATE(ERROR_ACTIVE, ERROR_WARNING, 96, 5),
     {ERR | CRTL | CNT, {0, 0x08, 0, 0, 0, 0, 96, 5}}, {ERR | CRTL, {0, 0x08}},
     {ERR | CRTL | CNT, {0, 0x08, 0, 0, 0, 0, 96, 5}}, {ERR | CRTL, {0, 0x08}},
     {ERR | CRTL | CNT, {0, 0x08, 0, 0, 0, 0, 96, 5}}},
    {"warning by both, rec larger", STATE(ERROR_ACTIVE, ERROR_WARNING, 96, 100),
     {ERR | CRTL | CNT, {0, 0x04, 0, 0, 0, 0, 96, 100}}, {ERR | CRTL, {0, 0x08}},
     {ERR | CRTL | CNT, {0, 0x04, 0, 0, 0, 0, 96, 100}}, {ERR | CRTL, {0, 0x0C}},
     {ERR | CRTL | CNT, {0, 0x04, 0, 0, 0, 0, 96, 100}}},
    {"warning by both alike", STATE(ERROR_ACTIVE, ERROR_WARNING, 96, 96),
     {ERR | CRTL | CNT, {0, 0x0C, 0, 0, 0, 0, 96, 96}}, {ERR | CRTL, {0, 0x08}},
     {ERR | CRTL | CNT, {0, 0x04, 0, 0, 0, 0, 96, 96}}, {ERR | CRTL, {0, 0x0C}},
     {ERR | CRTL | CNT, {0, 0x0C, 0, 0, 0, 0, 96, 96}}},
    {"warning by a lower limit", STATE(ERROR_ACTIVE, ERROR_WARNING, 20, 50),
     {ERR | CRTL | CNT, {0, 0x04, 0, 0, 0, 0, 20, 50}}, {ERR | CRTL, {0, 0x04}},
     {ERR | CRTL | CNT, {0, 0x04, 0, 0, 0, 0, 20, 50}}, {ERR | CRTL, {0, 0x04}},
     {ERR | CRTL | CNT, {0, 0x04, 0, 0, 0, 0, 20, 50}}},
    {"passive by both", STATE(ERROR_WARNING, ERROR_PASSIVE, 128, 136),
     {ERR | CRTL | CNT, {0, 0x10, 0, 0, 0, 0, 128, 136}}, {ERR | CRTL, {0, 0x20}},
     {ERR | CRTL | CNT, {0, 0x30, 0, 0, 0, 0, 128, 127}}, {ERR | CRTL, {0, 0x10}},
     {ERR | CRTL | CNT, {0, 0x10, 0, 0, 0, 0, 128, 136}}},
    {"passive by rec", STATE(ERROR_WARNING, ERROR_PASSIVE, 100, 128),
     {ERR | CRTL | CNT, {0, 0x10, 0, 0, 0, 0, 100, 128}}, {ERR | CRTL, {0, 0x10}},
     {ERR | CRTL | CNT, {0, 0x10, 0, 0, 0, 0, 100, 127}}, {ERR | CRTL, {0, 0x10}},
     {ERR | CRTL | CNT, {0, 0x10, 0, 0, 0, 0, 100, 128}}},
    {"back to warning", STATE(ERROR_PASSIVE, ERROR_WARNING, 127, 0),
     {ERR | CRTL | CNT, {0, 0x08, 0, 0, 0, 0, 127, 0}}, NONE,
     {ERR | CRTL | CNT, {0, 0x08, 0, 0, 0, 0, 127, 0}}, {ERR | CRTL, {0, 0x08}},
     {ERR | CRTL | CNT, {0, 0x08, 0, 0, 0, 0, 127, 0}}},
    {"back to active", STATE(ERROR_WARNING, ERROR_ACTIVE, 95, 1),
     {ERR | CRTL | CNT, {0, 0x40, 0, 0, 0, 0, 95, 1}}, NONE, NONE, {ERR | CRTL, {0, 0x40}}, NONE},
    {"bus-off", STATE(ERROR_PASSIVE, BUS_OFF, 256, 0), {ERR | BUSOFF, {0}}, {ERR | BUSOFF, {0}},
     {ERR | BUSOFF, {0}}, {ERR | BUSOFF, {0}}, {ERR | BUSOFF, {0}}},
    {"restarted", {.kind = CW_EVENT_RESTART}, {ERR | RESTARTED, {0}}, {ERR | RESTARTED, {0}},
     {ERR | RESTARTED, {0}}, {ERR | RESTARTED, {0}}, {ERR | RESTARTED, {0}}},
    {"active after a restart", STATE(BUS_OFF, ERROR_ACTIVE, 0, 0), NONE, NONE, NONE, NONE, NONE},
    {"overrun", {.kind = CW_EVENT_OVERRUN, .tec = 7, .rec = 2},
     {ERR | CRTL | CNT, {0, 0x01, 0, 0, 0, 0, 7, 2}}, {ERR | CRTL, {0, 0x01}},
     {ERR | CRTL, {0, 0x01}}, NONE, NONE},
    {"overrun while passive", {.kind = CW_EVENT_OVERRUN, .tec = 0, .rec = 130},
     {ERR | CRTL | CNT, {0, 0x01, 0, 0, 0, 0, 0, 130}}, {ERR | CRTL, {0, 0x11}},
     {ERR | CRTL, {0, 0x01}}, NONE, NONE},
    {"lost arbitration", {.kind = CW_EVENT_ARBITRATION_LOST, .lost_bit = 12, .tec = 4},
     {ERR | LOSTARB | CNT, {12, 0, 0, 0, 0, 0, 4, 0}}, NONE, NONE, NONE, NONE},
    {"queue full", {.kind = CW_EVENT_DROP, .why = CW_DROP_QUEUE_FULL}, NONE, NONE, NONE, NONE,
     NONE},
    {"no acknowledgement", FOUND(ACK, TX, CW_FIELD_ACK_SLOT, 0),
     {ERR | PROT | BUSERROR | CNT, {0, 0, 0x80, 0x19, 0, 0, 8, 3}}, NONE,
     {ERR | PROT | BUSERROR, {0, 0, 0, 0x19}}, {ERR | PROT | BUSERROR | ACK, {0, 0, 0, 0x19}},
     {ERR | PROT | BUSERROR | ACK, {0, 0, 0, 0x19}}},
    {"dominant bit not sent", FOUND(BIT, TX, CW_FIELD_DLC, 1 + CW_DOMINANT),
     {ERR | PROT | BUSERROR | CNT, {0, 0, 0x81, 0x0B, 0, 0, 8, 3}}, NONE,
     {ERR | PROT | BUSERROR, {0, 0, 0x08}}, {ERR | PROT | BUSERROR, {0, 0, 0x08}},
     {ERR | PROT | BUSERROR, {0, 0, 0x08}}},
    {"recessive bit not sent", FOUND(BIT, TX, CW_FIELD_DLC, 1 + CW_RECESSIVE),
     {ERR | PROT | BUSERROR | CNT, {0, 0, 0x81, 0x0B, 0, 0, 8, 3}}, NONE,
     {ERR | PROT | BUSERROR, {0, 0, 0x10}}, {ERR | PROT | BUSERROR, {0, 0, 0x10}},
     {ERR | PROT | BUSERROR, {0, 0, 0x10}}},
    {"bit compared late", FOUND(BIT, TX, CW_FIELD_DATA, 0),
     {ERR | PROT | BUSERROR | CNT, {0, 0, 0x81, 0x0A, 0, 0, 8, 3}}, NONE,
     {ERR | PROT | BUSERROR, {0, 0, 0x01}}, {ERR | PROT | BUSERROR, {0, 0, 0x01}},
     {ERR | PROT | BUSERROR, {0, 0, 0x01}}},
    {"stuff error", FOUND(STUFF, RX, CW_FIELD_DATA, 0),
     {ERR | PROT | BUSERROR | CNT, {0, 0, 0x04, 0x0A, 0, 0, 8, 3}}, NONE,
     {ERR | PROT | BUSERROR, {0, 0, 0x04}}, {ERR | PROT | BUSERROR, {0, 0, 0x04}},
     {ERR | PROT | BUSERROR, {0, 0, 0x04}}},
    {"form error", FOUND(FORM, RX, CW_FIELD_EOF, 0),
     {ERR | PROT | BUSERROR | CNT, {0, 0, 0x02, 0x1A, 0, 0, 8, 3}}, NONE,
     {ERR | PROT | BUSERROR, {0, 0, 0x02}}, {ERR | PROT | BUSERROR, {0, 0, 0x02}},
     {ERR | PROT | BUSERROR, {0, 0, 0x02}}},
    {"wrong crc", FOUND(CRC, RX, CW_FIELD_ACK_DELIMITER, 0),
     {ERR | PROT | BUSERROR | CNT, {0, 0, 0, 0x08, 0, 0, 8, 3}}, NONE,
     {ERR | PROT | BUSERROR, {0, 0, 0, 0x08}}, {ERR | PROT | BUSERROR, {0, 0, 0x01, 0x08}},
     {ERR | PROT | BUSERROR, {0, 0, 0x01, 0x08}}},
    {"tolerated", {.kind = CW_EVENT_TOLERATED, .tec = 8, .error = {.role = RX}},
     {ERR | PROT | BUSERROR | CNT, {0, 0, 0, 0x13, 0, 0, 8, 0}}, NONE, NONE, NONE, NONE},
};

static void check_driver(const driver_row *r, errframe_driver driver, const errframe *wanted)
{
    const bool error = r->event.kind == CW_EVENT_ERROR || r->event.kind == CW_EVENT_TOLERATED;
    errframe out;
    const bool made = errframe_from_event(&out, &r->event, ALL_MODES, driver);
    if (made != (wanted->can_id != 0))
        print_error("%s, driver %d\n", r->name, (int)driver);
    assert_int_equal(made, wanted->can_id != 0);
    if (!made)
        return;
    assert_int_equal(out.can_id, wanted->can_id);
    assert_memory_equal(out.data, wanted->data, sizeof out.data);
    assert_int_equal(errframe_from_event(&out, &r->event, 0, driver), !error);
}

/* The errors of a bus need berr-reporting; nothing else needs a mode. */
TEST(each_driver_has_its_habits)
{
    for (size_t i = 0; i < sizeof driver_rows / sizeof driver_rows[0]; i++) {
        const driver_row *r = &driver_rows[i];
        check_driver(r, ERRFRAME_SJA1000, &r->sja1000);
        check_driver(r, ERRFRAME_MCP251X, &r->mcp251x);
        check_driver(r, ERRFRAME_M_CAN, &r->m_can);
        check_driver(r, ERRFRAME_FLEXCAN, &r->flexcan);
        check_driver(r, ERRFRAME_BXCAN, &r->bxcan);
    }
}

TEST(no_frame_for_other_events)
{
    static const cw_event_kind kinds[] = {CW_EVENT_RX, CW_EVENT_TX, CW_EVENT_FAULT,
                                          CW_EVENT_OVERLOAD};
    errframe out;
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        const cw_event event = {.kind = kinds[i]};
        assert_false(errframe_from_event(&out, &event, ALL_MODES, ERRFRAME_ANY));
    }
    const cw_event one_shot = {.kind = CW_EVENT_DROP, .why = CW_DROP_ONE_SHOT};
    assert_false(errframe_from_event(&out, &one_shot, ALL_MODES, ERRFRAME_ANY));
}

/* A TEC above 255 has no place in data[6]: no counters then. */
TEST(bus_error_that_ends_in_bus_off)
{
    const cw_event event = {.kind = CW_EVENT_ERROR,
                            .tec = 256,
                            .error = {.role = TX, .place = {.field = CW_FIELD_SOF}}};
    errframe out;
    assert_true(errframe_from_event(&out, &event, ALL_MODES, ERRFRAME_ANY));
    assert_int_equal(out.can_id, ERR | PROT | BUSERROR);
    assert_int_equal(out.data[6], 0);
}

TEST(an_overflow_on_the_way_to_the_bus)
{
    const errframe e = errframe_rx_overflow();
    assert_int_equal(e.can_id, 0x20000004);
    assert_memory_equal(e.data, ((uint8_t[8]){0, 0x01}), 8);
    assert_true(errframe_is_minor(&e)); /* of a slow host, thousands a second */
    const cw_event overrun = {.kind = CW_EVENT_OVERRUN, .frame = {.id = 0x123}};
    errframe out;
    assert_true(errframe_from_event(&out, &overrun, 0, ERRFRAME_ANY));
    assert_memory_equal(&out, &e, sizeof e);
}

/* Linux drivers leave CAN_STATE_SLEEPING out of error frames. */
TEST(sleep_makes_no_error_frames)
{
    const cw_event events[] = {
        {.kind = CW_EVENT_WAKE},
        {.kind = CW_EVENT_STATE, .state = CW_STATE_SLEEPING},
        {.kind = CW_EVENT_STATE, .state_before = CW_STATE_SLEEPING},
        {.kind = CW_EVENT_STATE, .state = CW_STATE_ERROR_PASSIVE, .tec = 130,
         .state_before = CW_STATE_SLEEPING}};
    errframe out;
    for (errframe_driver driver = ERRFRAME_ANY; driver < ERRFRAME_DRIVERS; driver++)
        for (size_t i = 0; i < sizeof events / sizeof events[0]; i++)
            assert_false(errframe_from_event(&out, &events[i], UINT8_MAX, driver));
}

TEST(storm_is_limited_and_counted)
{
    const errframe minor = {.can_id = BERR};
    const errframe major = {.can_id = ERR | BUSOFF};
    errframe_limit limit = {.used = 0};
    for (unsigned i = 0; i < ERRFRAME_BURST; i++)
        assert_true(errframe_limit_pass(&limit, &minor, 100));
    assert_false(errframe_limit_pass(&limit, &minor, 100));
    assert_true(errframe_limit_pass(&limit, &major, 100));
    assert_false(errframe_limit_pass(&limit, &minor, ERRFRAME_REFILL_TICKS - 1));
    assert_int_equal(limit.left_out, 2);
    assert_true(errframe_limit_pass(&limit, &minor, ERRFRAME_REFILL_TICKS));
    assert_false(errframe_limit_pass(&limit, &minor, ERRFRAME_REFILL_TICKS));
    for (unsigned i = 0; i < ERRFRAME_BURST; i++)
        assert_true(errframe_limit_pass(&limit, &minor, (uint64_t)ERRFRAME_REFILL_TICKS * 1000));
    assert_int_equal(limit.left_out, 3);
}
