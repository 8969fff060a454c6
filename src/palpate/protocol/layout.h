#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

/// What the viewer's page and the program agree on besides the order of fields (docs/viewer.md): numbers of kinds,
/// columns of rows, limits. The page reads all of it from web/src/protocol.json, which protocolDescription() writes.
namespace palpate::protocol {

inline constexpr int kVersion = 1;

/// First number of a binary message.
enum class Kind : std::uint32_t { geometry = 1, frame = 2, samples = 3 };
/// Bits of a body in `geometry`.
enum BodyFlag : std::uint32_t { kToolBody = 1, kRigidBody = 2 };
/// Type of an obstacle in `geometry`.
enum class ObstacleKind : std::uint32_t { plane = 0, surface = 1 };
/// State of a contact in `frame`.
enum class ContactKind { open = 0, sticking = 1, sliding = 2 };

/// A recording begins with it.
inline constexpr std::string_view kRecordingMagic = "PALPATE1";
/// First number of a record of a recording. The page passes `extra` over.
enum class RecordKind : std::uint32_t { text = 0, binary = 1, extra = 2 };
/// First number of an `extra` record.
enum class ExtraKind : std::uint32_t { materials = 1, step = 2 };
/// Records and their payloads begin at multiples of this in a recording [bytes].
inline constexpr std::size_t kRecordAlignment = 8;

/// Part of a row of 4-byte numbers.
struct Column {
  const char* name;
  std::size_t width;  ///< in numbers
};

/// A contact in `frame`.
inline constexpr std::array kContactColumns{Column{"position", 3}, Column{"normal", 3}, Column{"force", 3},
                                            Column{"state", 1}};
/// A tick in `samples`; its flags are bits, the rest is f32.
inline constexpr std::array kTickColumns{Column{"time", 1}, Column{"sent", 6}, Column{"raw", 6}, Column{"vc", 6},
                                         Column{"flags", 1}};
/// A visual step in `samples`. Milliseconds: step, assemble, factorize, solve, contact, advance, linearization.
inline constexpr std::array kStepColumns{
    Column{"time", 1},     Column{"wrench", 6},     Column{"milliseconds", 7}, Column{"lateness", 1},
    Column{"found", 1},    Column{"reduced", 1},    Column{"active", 1},       Column{"sticking", 1},
    Column{"sliding", 1},  Column{"iterations", 1}, Column{"residual", 1},     Column{"penetration", 1},
    Column{"kinetic", 1},  Column{"elastic", 1},    Column{"status", 1},       Column{"substeps", 1},
    Column{"reserved", 1},
};

/// Numbers in a row.
template <std::size_t N>
constexpr std::size_t stride(const std::array<Column, N>& columns) {
  std::size_t sum = 0;
  for (const Column& column : columns) sum += column.width;
  return sum;
}

/// Byte of `samples` at which its u32 `lost` stands, which the server fills in.
inline constexpr std::size_t kLostOffset = 16;

/// What the page may ask for.
struct Limits {
  double low, high;
};
inline constexpr Limits kVisualStep{0.002, 0.2};  ///< [s]
inline constexpr Limits kFriction{0.0, 10.0};     ///< factor
inline constexpr Limits kStiffness{0.05, 20.0};   ///< factor
inline constexpr Limits kSpeed{0.02, 1.0};        ///< of simulated time against the clock
inline constexpr double kFarthest = 100.0;        ///< of a hand's coordinates from 0 [m]
inline constexpr std::size_t kMaxCommandBytes = 4096;
inline constexpr std::size_t kMaxTextBytes = 200;  ///< of a name in a command
inline constexpr Limits kSurfaceSize{0.005, 5.0};  ///< longest side of a dropped surface [m]
inline constexpr Limits kTetrahedra{10, 20000};    ///< wanted of it
inline constexpr Limits kBrush{1e-4, 5.0};         ///< radius of a brush that paints its handle [m]
inline constexpr std::size_t kMostDabs = 120;      ///< of that brush
inline constexpr std::size_t kMaxSurfaceBytes = std::size_t{64} << 20;

}  // namespace palpate::protocol
