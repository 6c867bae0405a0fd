/* SPDX-License-Identifier: MIT
 *
 * s_x.c - beyond the numbered cases.
 */
#include "net.h"
#include "timed.h"

#define TRIGGERED "init=T r11 set=5,9 "
#define RECOVERED "r10 r(T=0 R=0) "

static const net_case net_cases[] = {
    {"three identifiers",
     0,
     {{"123#55", "tx rx:124#66 rx:125#77", 0, 0, 0, 0, 0},
      {"124#66", "lost8 rx:123#55 tx rx:125#77", 0, 0, 0, 0, 0},
      {"125#77", "lost8 rx:123#55 lost10 rx:124#66 tx", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    {"data beats remote",
     0,
     {{"123#55", "tx rx:123#R1", 0, 0, 0, 0, 0},
      {"123#R1", "lost11 rx:123#55 tx", 0, 0, 0, 0, 0},
      {"", "rx:123#55 rx:123#R1", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    {"base remote beats extended",
     0,
     {{"123#R1", "tx rx:048C1234#55", 0, 0, 0, 0, 0},
      {"048C1234#55", "lost12 rx:123#R1 tx", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    {"base data beats extended",
     0,
     {{"123#55", "tx rx:048C1234#R5", 0, 0, 0, 0, 0},
      {"048C1234#R5", "lost11 rx:123#55 tx", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    /* Flags from DLC 3, from CRC 0 and, of the receiver, after the sixth dominant bit. */
    {"ctn: same identifier, other DLC",
     12,
     {{"123#11", "bit:dlc3:tx:active tx", 7, 0, 0, 0, 0},
      {"123#1122", "bit:dlc2:tx:active drop rx:123#11", 8, 0, 0, 0, CW_MODE_ONE_SHOT},
      {"", "stuff:crc2s:rx:active rx:123#11", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    /* The receiver takes the DLC for 0, so that a fixed stuff bit follows. */
    {"f: same identifier, other DLC",
     9,
     {{"123#11", "bit:dlc3:tx:active tx", 7, 0, 0, 0, 0},
      {"123#1122", "bit:dlc2:tx:active drop rx:123#11", 8, 0, 0, 0, CW_MODE_ONE_SHOT},
      {"", "form:fs0:rx:active rx:123#11", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    {"same identifier, other data",
     12,
     {{"123#00", "bit:data4s:tx:active tx", 7, 0, 0, 0, 0},
      {"123#80", "bit:data0:tx:active drop rx:123#00", 8, 0, 0, 0, CW_MODE_ONE_SHOT},
      {"", "stuff:data4s:rx:active rx:123#00", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    {"two identical remote frames",
     0,
     {{"123#R1", "tx", 0, 0, 0, 0, 0},
      {"123#R1", "tx", 0, 0, 0, 0, 0},
      {"", "rx:123#R1", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    {"two identical data frames",
     0,
     {{"12345678#AA", "tx", 0, 0, 0, 0, 0},
      {"12345678#AA", "tx", 0, 0, 0, 0, 0},
      {"", "rx:12345678#AA", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    /* No node is left to acknowledge: both attempts fail, as both nodes are transmitters. */
    {"two identical frames and no receiver",
     6,
     {{"123#55", "ack:ackend:tx:active drop", 8, 0, 0, 0, CW_MODE_ONE_SHOT},
      {"123#55", "ack:ackend:tx:active drop", 8, 0, 0, 0, CW_MODE_ONE_SHOT}},
     NULL,
     NULL,
     0},
    {"one node acknowledges",
     0,
     {{"123#55", "tx", 0, 0, 0, 0, 0},
      {"", "rx:123#55", 0, 0, 0, 0, CW_MODE_LISTEN_ONLY},
      {"", "rx:123#55", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    {"nobody acknowledges, active",
     0,
     {{"123#55", "ack:ackend:tx:active drop", 8, 0, 0, 0, CW_MODE_ONE_SHOT},
      {"", "form:ackdel0:rx:active", 0, 0, 0, 0, CW_MODE_LISTEN_ONLY}},
     NULL,
     NULL,
     0},
    /* R3 i; the passive flag is not seen by anybody. */
    {"nobody acknowledges, passive",
     0,
     {{"123#55", "ack:ackend:tx:passive drop", 128, 0, 128, 0, CW_MODE_ONE_SHOT},
      {"", "rx:123#55", 0, 0, 0, 0, CW_MODE_LISTEN_ONLY}},
     NULL,
     NULL,
     0},
    {"an active node sends back to back",
     0,
     {{"100# 101#", "tx tx rx:7FF#", 0, 0, 0, 0, 0},
      {"7FF#", "lost0 rx:100# lost0 rx:101# tx", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    /* M8: the other one gets the bus while the passive node is suspended. */
    {"a passive node lets the other one in",
     0,
     {{"100# 101#", "tx rx:7FF# tx", 148, 0, 150, 0, 0},
      {"7FF#", "lost0 rx:100# tx rx:101#", 0, 0, 0, 0, 0}},
     NULL,
     NULL,
     0},
    {"all see the error at once",
     7,
     {{"123#3B", "form:crcdel0:tx:active tx", 7, 0, 0, 0, 0},
      {"", "form:crcdel0:rx:active rx:123#3B", 0, 0, 0, 0, 0},
      {"", "form:crcdel0:rx:active rx:123#3B", 0, 0, 0, 0, 0}},
     "123#3B",
     "crcdel",
     NET_ALL},
    {"passive transmitter, active receivers",
     7,
     {{"123#3B", "form:crcdel0:tx:passive tx", 207, 0, 200, 0, 0},
      {"", "form:crcdel0:rx:active rx:123#3B", 0, 0, 0, 0, 0}},
     "123#3B",
     "crcdel",
     NET_ALL},
    /* The flag of the last node takes the arbitration away from the first. */
    {"local error in the identifier",
     12,
     {{"07A#55", "lost4 stuff:id8s:rx:active tx", 0, 1, 0, 0, 0},
      {"", "stuff:id8s:rx:active rx:07A#55", 0, 0, 0, 0, 0},
      {"", "stuff:id3s:rx:active tol rx:07A#55", 0, 8, 0, 0, 0}},
     "07A#55",
     "id3s",
     2},
    {"ctn: local error in the data",
     12,
     {{"123#07", "bit:data5:tx:active tx", 7, 0, 0, 0, 0},
      {"", "stuff:crc1s:rx:active rx:123#07", 0, 0, 0, 0, 0},
      {"", "stuff:data4s:rx:active tol rx:123#07", 0, 8, 0, 0, 0}},
     "123#07",
     "data4s",
     2},
    /* A data field of one byte, and of more. */
    {"f: local error in the data",
     10,
     {{"123#07", "bit:data5:tx:active tx", 7, 0, 0, 0, 0},
      {"", "form:fs0:rx:active rx:123#07", 0, 0, 0, 0, 0},
      {"", "stuff:data4s:rx:active tol rx:123#07", 0, 8, 0, 0, 0}},
     "123#07",
     "data4s",
     2},
    {"l: local error in the data",
     12,
     {{"123#07", "bit:data5:tx:active tx", 7, 0, 0, 0, 0},
      {"", "stuff:data9s:rx:active rx:123#07", 0, 0, 0, 0, 0},
      {"", "stuff:data4s:rx:active tol rx:123#07", 0, 8, 0, 0, 0}},
     "123#07",
     "data4s",
     2},
    {"a passive receiver cannot globalise",
     0,
     {{"123#07", "tx", 0, 0, 0, 0, 0},
      {"", "rx:123#07", 0, 0, 0, 0, 0},
      {"", "stuff:data4s:rx:passive", 0, 151, 0, 150, 0}},
     "123#07",
     "data4s",
     2},
    {"message doubling",
     7,
     {{"123#55", "form:eof6:tx:active tx", 7, 0, 0, 0, 0},
      {"", "rx:123#55 ovl rx:123#55", 0, 0, 0, 0, 0}},
     "123#55",
     "eof6",
     0},
    {"the last bit of EOF for all",
     7,
     {{"123#55", "form:eof6:tx:active tx", 7, 0, 0, 0, 0},
      {"", "rx:123#55 ovl rx:123#55", 0, 0, 0, 0, 0}},
     "123#55",
     "eof6",
     NET_ALL},
};

static void several_nodes(void)
{
    for (size_t i = 0; i < sizeof net_cases / sizeof net_cases[0]; i++)
        net_run(&net_cases[i]);
}

static void error_events(void);

static const test_case cases[] = {
    /* Offered at the start, sent in the bit after the eleventh recessive one. */
    {"X1", "init= offer=" F " r11 " AGAIN, NULL},
    {"X1", "init= offer=" F " r10 d r10 d r11 " AGAIN, NULL},
    {"X1", "ctn: init= offer=" F " r5 d20 r7 -456#AA r3 " AGAIN, NULL},
    {"X1", "flo: init= offer=" F " r5 d20 r7 -456#AA r2 " AGAIN, NULL},
    {"X1", "init= r10 -456#AA r3 <456#AA r3", NULL},
    {"X1", "init= r11 <456#AA r3", NULL},
    {"X1", "init= r11 d >07A#55@id0 r3", NULL},
    {"X1", "ctn: modes=L modes= offer=" F " r4 -456#AA r2 d r11 " AGAIN, NULL},
    {"X1", "flo: modes=L modes= offer=" F " r4 -456#AA r d r11 " AGAIN, NULL},
    {"X1", "<" F ":data3 modes=L modes= d(at none) d5 r10 d6 r10 d r11 <" F " r3", NULL},
    {"X1", "r5 d modes=L modes= offer=" F " r11 " AGAIN, NULL},
    /* one-shot and presume-ack do not touch the wire: the node stays on the bus */
    {"X1", "modes=O <" F " r3 modes=A <" F " r3", NULL},
    {"X2", "set=256,77 restart 127[r11 d] 2[r10 d] " RECOVERED AGAIN, NULL},
    {"X2", "set=256,0 restart 127[r11] " RECOVERED AGAIN, NULL},
    {"X2", "set=256,0 restart 63[r22 d] r11 " RECOVERED AGAIN, NULL},
    {"X2", "set=263,0 200[r11] -" F " r3 restart 127[r11] " RECOVERED AGAIN, NULL},
    {"X2", "set=256,0 r refuse=" F " restart no-restart refuse=" F " 127[r11] " RECOVERED, NULL},
    /* Back without further integration: also the first bit of a foreign frame is seen. */
    {"X2", "set=256,0 restart 127[r11] " RECOVERED "<" F " r3", NULL},
    {"X2", "no-restart r3", NULL},
    {"X2", "2[set=256,0 restart 127[r11] r10 r(T=0 R=0)] " AGAIN, NULL},
    {"X2", ">" F ":data0 set=256,0 r(at none drop) r20 restart 127[r11] r10(at none) r(T=0 R=0)",
     NULL},
    {"X2", "set=256,0 modes=O r20 restart 20[r11] modes= 107[r11] " RECOVERED AGAIN, NULL},
    {"X2", "set=256,0 r20 set=10,0 r11 <" F " r3", NULL},
    {"X3", "set=10,10 >07A#55:id3s ~(stuff id3s tx act) " ACTIVE ">07A#55 r3", NULL},
    {"X3", "set=150,10 >07A#55:id3s ~(stuff id3s tx pas) " PASSIVE SUSPEND ">07A#55 r3", NULL},
    {"X3", "set=10,10 >00000000#:id15s ~(stuff id15s tx act) " ACTIVE ">00000000# r3", NULL},
    /* Behind the last bit of the arbitration field; behind the IDE bit of a base frame. */
    {"X3", "set=10,10 >560#C3:id10s ~(stuff id10s tx act) " ACTIVE ">560#C3 r3", NULL},
    {"X3", "set=10,10 >758#:ide0s ~(bit ide0s tx act T+8) " ACTIVE ">758# r3", NULL},
    /* Behind the RTR bit it is a bit error like any other: both formats, active and passive. */
    {"X3", "set=10,10 >078#E1:rtr0s ~(bit rtr0s tx act T+8) " ACTIVE ">078#E1 r3", NULL},
    {"X3", "set=150,10 >078#E1:rtr0s ~(bit rtr0s tx pas T+8) " PASSIVE SUSPEND ">078#E1 r3", NULL},
    {"X3", "set=10,10 >1FFFFFF0#:rtr0s ~(bit rtr0s tx act T+8) " ACTIVE ">1FFFFFF0# r3", NULL},
    /* the last one before it, in both formats */
    {"X3", "set=10,10 >0AAAAAE0#55:id28s ~(stuff id28s tx act) " ACTIVE ">0AAAAAE0#55 r3", NULL},
    /* to a receiver it is a stuff error */
    {"X3", "set=10,10 <078#E1:rtr0s ~(stuff rtr0s rx act R+1) " ACTIVE, NULL},
    {"X4", "init=L r11 set=5,5 <" F " r3 <12345678#R4 r3", NULL},
    {"X4", "init=L r11 set=5,5 <" F ":ack d +r <" F "@ackdel r3", NULL},
    {"X4", "init=L r11 set=5,5 <" F ":crcdel d(form crcdel rx act) r6 r8 r3", NULL},
    {"X4", "init=L r11 set=5,5 <07A#55:id3s ~(stuff id3s rx act) r6 r8 r3", NULL},
    {"X4", "init=L r11 set=5,5 <" F "~data0:ack d +r r(crc ackdel rx act) r6 r8 r3", NULL},
    {"X4", "init=L r11 set=5,5 <" F " d(ovl) {r6|d6|d7} r8 r3", NULL},
    {"X4", "init=L r11 set=5,5 <" F ":eof6 d(ovl) r6 r8 r3", NULL},
    {"X4", "init=L r11 set=5,150 <" F ":crcdel d(form crcdel rx pas) r6 r8 r3", NULL},
    {"X4", "init=L r11 refuse=" F " r20 d6(stuff id3s rx act) r6 r8 r3", NULL},
    {"X4", "init=L r11 <" F " r3 modes= r7 -" F " r3 <" F " r3", NULL},
    {"X5", "set=0,{252|253} " RX_ERROR_PASSIVE PASSIVE, NULL},
    {"X5", "set=0,254 " RX_ERROR_PASSIVE PASSIVE "<" F ":crcdel d(form crcdel rx pas) " PASSIVE,
     NULL},
    {"X5", "set=0,250 " RX_ERROR_PASSIVE "r6 d(tol R+4) r8 r3", NULL},
    {"X5", "set={127|128},0 >" F ":data0 ~(bit here tx {act|pas} T+8) {D6|r6} r8 r3 " SUSPEND AGAIN,
     NULL},
    {"X5", "set=0,{127|128} >" F ":data0 ~(bit here tx {act|pas} T+8) {D6|r6} r8 r3 {r0|r8} " AGAIN,
     NULL},
    {"X5",
     "set={0|0|127|128},{127|128|0|0} <" F
     ":crcdel d(form crcdel rx {act|pas|act|pas} R+1) {D6|r6|D6|r6} r8 r3",
     NULL},
    /* Active again: no more suspend. */
    {"X5", "set={128|129|128},{127|127|128} >" F " offer=456#AA r3 {r0|r8|r8} >456#AA r3", NULL},
    {"X5", "set={127|129},128 <456#AA r3 >" F " offer=124#AA r3 {r0|r8} >124#AA r3", NULL},
    {"X5", "set=247,0 >" F ":data0 ~(bit here tx pas T+8) " PASSIVE SUSPEND AGAIN, NULL},
    {"X5", "set=248,0 >" F ":data0 ~(bit here tx none T+8 drop) r50 away", NULL},
    {"X6", "set=0,150 " RX_ERROR_PASSIVE "r6 d(tol R+8) r8 r3", NULL},
    {"X6", "set=0,150 " RX_ERROR_PASSIVE "{d6|r3 d6} d(tol R+8) r8 r3", NULL},
    {"X6", "set=0,150 " RX_ERROR_PASSIVE "r6 d(tol R+8) d6 d(tol R+8) d7 d(tol R+8) r8 r3", NULL},
    {"X7", "r5 d offer={07A|7C5}#55 >{07A|7C5}#55@id0 r3", NULL},
    {"X7", "<" F " r2 d offer={07A|7C5}#55 >{07A|7C5}#55@id0 r3", NULL},
    {"X7", "r5 d offer=01E80000#55 >01E80000#55@id0 r3", NULL},
    /* One bit too late; or in suspend: then it receives. */
    {"X7", "r5 <" F ":id1 offer=456#AA <" F "@id1 r3 >456#AA r3", NULL},
    {"X7", "set=150,0 >124#AA r{2|3|10} <" F ":id0 offer=456#AA <" F "@id0 r3 >456#AA r3", NULL},
    /* It joins and loses, in its first bit or later. */
    {"X7", "r5 d *{456|124}#55/123#AA@id0 r3 >{456|124}#55 r3", NULL},
    {"X8", NULL, several_nodes},
    {"X9", "init=O r11 >" F ":data0 ~(bit here tx act T+8 drop) " ACTIVE, NULL},
    {"X9", "init=O r11 *456#55/123#AA r3", NULL},
    {"X9", "init=O r11 >" F ":ack +r r(ack ackend tx act T+8 drop) " ACTIVE, NULL},
    {"X9", "init=O r11 >" F ":eof6 d(form eof6 tx act T+8 drop) " ACTIVE, NULL},
    {"X9", "init=O r11 >07A#55:id3s ~(stuff id3s tx act drop) " ACTIVE, NULL},
    {"X9", "init=O r11 set=9,0 >" F " r3 >456#AA r3", NULL},
    {"X9", "init=O r11 >" F ":data0 ~(bit here tx act T+8 drop) " ACTIVE ">456#AA r3", NULL},
    {"X9",
     "init=O r11 set=150,0 >" F ":data0 ~(bit here tx pas T+8 drop) offer=456#AA " PASSIVE SUSPEND
     ">456#AA r3",
     NULL},
    {"X9", "init=O r11 set=248,0 >" F ":data0 ~(bit here tx none T+8 drop) r50 away", NULL},
    {"X10", NULL, error_events},
    {"X10", "<" F ":ack X(bit ack rx act R+1) " ACTIVE, NULL},
    {"X10", "<" F "~crc7:ack d +r r(crc ackdel rx act R+1) " ACTIVE, NULL},
    {"X10", ">" F ":ack +r r(ack ackend tx act T+8) " ACTIVE AGAIN, NULL},
    {"X10", "*123#R5/123#55 r3 >123#R5 r3", NULL},
    {"X10", "*048C1234#R1/048C1234#55 r3 >048C1234#R1 r3", NULL},
    /* O1 a: the flag starts in the first bit of the intermission; two in a row. */
    /* Positions of the bits outside frames. */
    {"X10",
     RX_ERROR "D(at errflag0) D4 D(at errflag5) r(at errdel0) r6 r(at errdel7) "
              "r(at int0) r r(at int2) r(at none)",
     NULL},
    {"X10",
     "<" F " d(at int0 ovl) D(at ovlflag0) D4 D(at ovlflag5) r(at ovldel0) r6 r(at ovldel7) "
     "r3",
     NULL},
    {"X10",
     "set=150,0 " TX_ERROR_PASSIVE
     "r(at errflag0) r5 r8 r3 r(at susp0) r6 r(at susp7) withdraw r(at none)",
     NULL},
    {"X11", "overload=1 <" F ":eof6 r(ovl) " ACTIVE "<" F " r3", NULL},
    {"X11", "overload=2 <" F ":eof6 r(ovl) D6 r7 r(ovl) " ACTIVE "<" F " r3", NULL},
    /* two in a row again: after a frame whose SOF replaced the third bit of intermission, and after
     * the bus was idle */
    {"X11", "overload=2 <" F ":eof6 r(ovl) D6 r7 r(ovl) D6 r8 r2 overload=2 <" F
            ":eof6 r(ovl) D6 r7 r(ovl) " ACTIVE "<" F " r3", NULL},
    {"X11", "overload=2 <" F ":eof6 r(ovl) D6 r7 r(ovl) " ACTIVE "r9 overload=2 <" F
            ":eof6 r(ovl) D6 r7 r(ovl) " ACTIVE "<" F " r3", NULL},
    {"X11", "overload=1 " RX_ERROR "D6 r7 r(ovl) " ACTIVE, NULL},
    {"X11",
     "overload=2 <" F ":eof6 r(ovl) D6 r7 r(ovl) overload=1 D6 r8 r3 <" F ":eof6 r(ovl) " ACTIVE,
     NULL},
    {"X11", "set=10,0 overload=1 >" F ":eof6 r(tx ovl T-1) " ACTIVE, NULL},
    {"X12", "init=A r11 >" F ":ack r +r >" F "@ackdel r3", NULL},
    {"X12", "init=A r11 set=10,0 >" F ":ack d +r >" F "@ackdel r3", NULL},
    {"X13", "offer=456#AA offer=" F " " AGAIN, NULL},
    {"X13", "offer=456#AA withdraw r5 >" F ":data0 refuse=456#AA no-withdraw >" F "@data0 r3",
     NULL},
    {"X13", "*456#55/123#AA offer=124#AA r3 >124#AA r3", NULL},
    {"X13", "*456#55/123#AA withdraw r30", NULL},
    {"X13", TX_ERROR "withdraw " ACTIVE, NULL},
    {"X13", TX_ERROR "offer=456#AA " ACTIVE ">456#AA r3", NULL},
    /* An offer ends once: bus-off drops it, whenever it comes; what follows is another one. */
    {"X13", "offer=456#AA set=256,0 r(drop) r50 restart 127[r11] " RECOVERED "r20", NULL},
    {"X13", "offer=456#AA set=256,0 restart r(drop) r10 126[r11] " RECOVERED AGAIN, NULL},
    {"X13", "offer=456#AA set=256,0 withdraw r20 away", NULL},
    {"X13", "offer=456#AA set=256,0 set=10,0 r11 >456#AA r3", NULL},
    {"X13", "*456#55/123#AA set=256,0 r(drop) r20 away", NULL},
    {"X13", "init=O r11 offer=456#AA set=256,0 r(drop) r20 away", NULL},
    /* cut off, frame or flag, it is kept and sent when it is back */
    {"X13", ">456#AA:data0 disconnect r20 d20(at none) reconnect r11 >456#AA r3", NULL},
    {"X13", TX_ERROR "D3 disconnect d20 r5 reconnect r11 " AGAIN, NULL},
    {"X13", "*456#55/123#AA:data0 disconnect r20 reconnect r11 >456#55 r3", NULL},
    {"X13", "init=O r11 >456#AA:data0 disconnect r3 reconnect r11 >456#AA r3", NULL},
    {"X13", ">456#AA:data0 modes=L r20 modes= r11 >456#AA r3", NULL},
    {"X13", ">456#AA:data0 modes=B d11 >456#AA d3 modes= r11 " AGAIN, NULL},
    {"X13", ">456#AA:data0 disconnect withdraw r5 reconnect r11 r20", NULL},
    /* bus-off counts on, or is ended, wherever the line is */
    {"X13", "set=256,0 disconnect reconnect r20 restart 60[r11] disconnect 67[r11] " RECOVERED,
     NULL},
    {"X13", "disconnect set=256,0 restart 127[r11] " RECOVERED AGAIN, NULL},
    {"X14", "init=B d11 >" F " d3 >12345678#AA r3 d20 away", NULL},
    {"X15", NULL, timed_run_intermission},
    {"X16", NULL, timed_run_triple_sampling},
    {"X18", NULL, timed_run_suspend},
    {"X19", NULL, timed_run_listen_only},
    {"X20", NULL, timed_run_recovery},
    /* L1: one attempt, no flag; eleven recessive bits, and it takes part again. */
    {"X17", TRIGGERED ">" F ":data0 ~(bit here tx none T+8 drop) r11 " AGAIN, NULL},
    {"X17", TRIGGERED ">" F ":data0 ~(bit here tx none T+8 drop) d6 r10 d r11 <" F " r3", NULL},
    {"X17", TRIGGERED "*456#55/123#AA r3 " AGAIN, NULL},
    {"X17", TRIGGERED "<" F ":ack X(bit ack rx none R+1) r11 " AGAIN, NULL},
    {"X17", TRIGGERED "<" F ":{crcdel|ackdel|eof0|eof5} "
            "d(form {crcdel|ackdel|eof0|eof5} rx none R+1) r11 " AGAIN, NULL},
    {"X17", TRIGGERED "<" F ":eof6 d r11 " AGAIN, NULL},
    {"X17", TRIGGERED ">" F ":eof6 d(form eof6 tx none T+8 drop) r11 " AGAIN, NULL},
    {"X17", TRIGGERED "<" F " r{0|1} d r11 " AGAIN, NULL},
    {"X17", TRIGGERED "<" F " r2 <456#AA r3", NULL},
    {"X17", TRIGGERED "<" F "~data0:ack {r|d} +r r(crc ackdel rx none R+1) r11 " AGAIN, NULL},
    {"X17", TRIGGERED "<07A#55:id3s ~(stuff id3s rx none R+1) d20 r10 d r11 " AGAIN, NULL},
    {"X17", TRIGGERED "overload=2 <" F " r3 " AGAIN, NULL},
    /* The others send an active flag and their delimiter: it is idle when they are. */
    {"X17", TRIGGERED "<" F ":crcdel d(form crcdel rx none R+1) d6 r8 r3 " AGAIN, NULL},
    /* Passive: the flag would be hidden, too. It owes no suspend time, but after a good frame. */
    {"X17", "init=T r11 set=5,150 <" F ":crcdel d(form crcdel rx none R+1) r11 " AGAIN, NULL},
    {"X17", "init=T r11 set=150,0 >" F ":data0 ~(bit here tx none T+8 drop) r11 >" F " r11", NULL},
    {"X17", "init=T r11 set=150,0 >124#AA offer=456#AA r11 >456#AA r11", NULL},
    {"X17", "init=T r11 set=248,0 >" F ":data0 ~(bit here tx none T+8 drop) r50 away", NULL},
    /* The missing acknowledgement; R3 i. */
    {"X17", TRIGGERED ">" F ":ack +r r(ack ackend tx none T+8 drop) r11 " AGAIN, NULL},
    {"X17", "init=T r11 set=130,0 >" F ":ack +r r(ack ackend tx none drop) d6 r11 >" F " r11",
     NULL},
    {"X17", "modes=T <" F " r3 >" F ":data0 modes= ~(bit here tx act T+8) " ACTIVE AGAIN, NULL},
};

/* Checks the error of a wrong level in every bit up to EOF, for both roles. */
static void error_events(void)
{
    static const char *const frames[] = {"245#C3A5", "0915A5C3#0FF0", "123#1122334455667788"};
    wire w;
    char place[NAME_MAX_LENGTH];

    for (size_t f = 0; f < sizeof frames / sizeof frames[0]; f++) {
        if (!wire_parse(&w, frames[f]))
            bench_count("malformed frame");
        for (unsigned i = 0; i < w.length; i++) {
            const wire_bit *bit = &w.bit[i];
            bool fixed = i + 1 >= w.ack;
            if (bit->place.field == CW_FIELD_ACK_SLOT)
                continue;
            wire_place_text(place, bit->place);
            if (!bit->place.stuff && !(bit->arbitration && bit->level))
                bench_run(">%s:%s ~(%s here tx act T+8) " ACTIVE ">%s r3", frames[f], place,
                          fixed ? "form" : "bit", frames[f]);
            if (fixed && i + 1 < w.length)
                bench_run("<%s:%s ~(form here rx act R+1) " ACTIVE, frames[f], place);
        }
    }
}

const section section_x = {"X", cases, sizeof cases / sizeof cases[0]};
