/* SPDX-License-Identifier: MIT
 *
 * pcapng_format.h - constants of the pcapng format, shared by its reader and its writer.
 */
#ifndef CANWIRE_TRACE_PCAPNG_FORMAT_H
#define CANWIRE_TRACE_PCAPNG_FORMAT_H

#define LINKTYPE_CAN_SOCKETCAN 227u

#define BLOCK_HEAD 8u /* type and length */
#define BLOCK_FOOT 4u /* the length again */
#define BLOCK_SHB 0x0A0D0D0Au
#define BLOCK_IDB 1u
#define BLOCK_PB 2u
#define BLOCK_SPB 3u
#define BLOCK_NRB 4u /* names of hosts */
#define BLOCK_ISB 5u /* statistics of interfaces */
#define BLOCK_EPB 6u
#define BLOCK_DSB 10u /* keys */
#define BYTE_ORDER_MAGIC 0x1A2B3C4Du

#define OPTION_END 0u
#define OPTION_SHB_USERAPPL 4u
#define OPTION_IF_NAME 2u
#define OPTION_IF_DESCRIPTION 3u
#define OPTION_IF_SPEED 8u
#define OPTION_IF_TSRESOL 9u
#define OPTION_IF_TSOFFSET 14u
#define OPTION_EPB_FLAGS 2u
#define EPB_INBOUND 1u
#define EPB_OUTBOUND 2u

/* A packet is a CAN frame in SocketCAN's layout with a big-endian identifier. */
#define CAN_HEAD 8u       /* identifier, length, flags, reserved, DLC over 8 */
#define CAN_BYTES_MAX 16u /* of a classical frame */
#define CAN_FD_BYTES_MAX 72u
#define CAN_EXTENDED 0x80000000u
#define CAN_REMOTE 0x40000000u
#define CAN_ERROR 0x20000000u
#define CAN_BRS 0x01u /* flags of CAN FD frames */
#define CAN_ESI 0x02u
#define CAN_FDF 0x04u
#define CAN_XLF 0x80u
#define CAN_XL_HEAD 12u /* its length is in bytes 6 and 7, the lower one first */
#define CAN_XL_BYTES_MAX (CAN_XL_HEAD + 2048u)

#endif
