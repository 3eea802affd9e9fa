#include "sim/modbus/spoiled_answer.h"

namespace lightrig::sim {
namespace {

constexpr std::size_t tcp_function = 7;  ///< where the function code stands
constexpr std::chrono::milliseconds between_bytes{2};

// Another transaction number, or another unit with a sound checksum.
Bytes with_wrong_id(Bytes answer, bool tcp) {
  if (tcp) {
    answer[1] = static_cast<std::uint8_t>(answer[1] ^ 0x55);
    return answer;
  }
  answer[0] = static_cast<std::uint8_t>(answer[0] + 1);
  const std::uint16_t crc = crc16(std::span(answer).first(answer.size() - 2));
  answer[answer.size() - 2] = static_cast<std::uint8_t>(crc & 0xff);
  answer[answer.size() - 1] = static_cast<std::uint8_t>(crc >> 8);
  return answer;
}

// RTU has a checksum, so any bit will do. Modbus TCP has none of its own and leaves the data to
// TCP's: what can come out wrong there is the framing.
Bytes corrupted(Bytes answer, bool tcp) {
  const std::size_t at = tcp ? tcp_function : answer.size() / 2;
  answer[at] = static_cast<std::uint8_t>(answer[at] ^ 0x10);
  return answer;
}

}  // namespace

std::vector<LateBytes> spoiled(const Bytes& answer, const WireFault& fault, bool tcp) {
  using std::chrono::milliseconds;
  const milliseconds now{0};
  switch (fault.effect) {
    case WireEffect::silence:
    case WireEffect::lost_answer:
    case WireEffect::closed:
      return {};
    case WireEffect::late:
      return {{fault.duration, answer}};
    case WireEffect::duplicate: {
      // In one piece: a second answer that came later could be any late answer.
      Bytes twice = answer;
      twice.insert(twice.end(), answer.begin(), answer.end());
      return {{now, twice}};
    }
    case WireEffect::wrong_id:
      return {{now, with_wrong_id(answer, tcp)}};
    case WireEffect::truncated:
      return {{now, Bytes(answer.begin(), answer.begin() + static_cast<long>(answer.size() / 2))}};
    case WireEffect::corrupted:
      return {{now, corrupted(answer, tcp)}};
    case WireEffect::short_reads: {
      std::vector<LateBytes> bytes;
      for (std::size_t i = 0; i < answer.size(); ++i)
        bytes.push_back({static_cast<long>(i) * between_bytes, {answer[i]}});
      return bytes;
    }
    default:
      return {{now, answer}};
  }
}

}  // namespace lightrig::sim
