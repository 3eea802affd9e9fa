#include "daemon/session/journal.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <system_error>
#include <utility>

#include "config/json_text.h"
#include "core/check.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/json_parse.h"

namespace lightrig {
namespace {

using nlohmann::ordered_json;

constexpr std::array<std::uint32_t, 256> make_crc_table() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t c = i;
    for (int bit = 0; bit < 8; ++bit) c = (c & 1U) != 0 ? 0xEDB88320U ^ (c >> 1U) : c >> 1U;
    table[i] = c;
  }
  return table;
}

/// CRC-32 as in ISO 3309 and PNG.
std::uint32_t crc32(std::string_view text) {
  static constexpr auto table = make_crc_table();
  std::uint32_t c = 0xFFFFFFFFU;
  for (const char ch : text) c = table[(c ^ static_cast<unsigned char>(ch)) & 0xFFU] ^ (c >> 8U);
  return c ^ 0xFFFFFFFFU;
}

// A line ends with exactly this, crc being of the line as it would read without it.
std::string crc_suffix(std::string_view body) {
  return fmt::format(",\"crc\":\"{:08x}\"}}", crc32(body));
}
constexpr std::size_t suffix_length = 18;

std::string to_line(std::uint64_t sequence, const std::string& event, const ordered_json& fields) {
  ordered_json line;
  line["seq"] = sequence;
  line["event"] = event;
  for (const auto& [key, value] : fields.items()) line[key] = value;
  std::string body = json_text(line);
  const std::string suffix = crc_suffix(body);
  body.pop_back();
  return body + suffix + "\n";
}

/// The event of one line (without its newline); empty when the line is not one that was written
/// whole.
std::optional<JournalEvent> parse_line(std::string_view line) {
  if (line.size() <= suffix_length) return std::nullopt;
  std::string body(line.substr(0, line.size() - suffix_length));
  body += '}';
  if (line.substr(line.size() - suffix_length) != crc_suffix(body)) return std::nullopt;
  auto parsed = parse_json(body);
  if (!parsed) return std::nullopt;
  ordered_json json = std::move(*parsed);
  if (!json.is_object() || !json.contains("seq") || !json["seq"].is_number_unsigned() ||
      !json.contains("event") || !json["event"].is_string()) {
    return std::nullopt;
  }
  JournalEvent event;
  event.sequence = json["seq"].get<std::uint64_t>();
  event.event = json["event"].get<std::string>();
  json.erase("seq");
  json.erase("event");
  event.fields = std::move(json);
  return event;
}

tl::unexpected<Error> journal_failure(const char* doing, const std::filesystem::path& path,
                                      int number) {
  const bool full = number == ENOSPC || number == EDQUOT;
  return fail(
      full ? ErrorCode::no_space : ErrorCode::refused,
      fmt::format("{} journal '{}': {}{}", doing, path.string(),
                  std::generic_category().message(number), full ? "; free some space there" : ""));
}

}  // namespace

Result<Replay> replay_journal(const std::filesystem::path& path) {
  const auto text = read_file(path);
  if (!text) return tl::unexpected(text.error());
  Replay replay;
  std::size_t begin = 0;
  int line_number = 0;
  while (begin < text->size()) {
    ++line_number;
    const std::size_t end = text->find('\n', begin);
    // An event is appended by one write that ends in a newline: what has none was cut short.
    if (end == std::string::npos) {
      replay.torn_tail = true;
      break;
    }
    auto event = parse_line(std::string_view(*text).substr(begin, end - begin));
    if (!event || event->sequence != replay.events.size() + 1) {
      return fail(
          ErrorCode::invalid_input,
          fmt::format("replay journal '{}': line {} {}; nothing was changed: restore the folder "
                      "from a copy, or move this file aside to begin the session anew",
                      path.string(), line_number,
                      event ? fmt::format("has sequence number {} where {} was expected: lines are "
                                          "missing or doubled",
                                          event->sequence, replay.events.size() + 1)
                            : "is damaged (its checksum does not match)"));
    }
    replay.events.push_back(std::move(*event));
    begin = end + 1;
    replay.good_bytes = begin;
  }
  return replay;
}

Result<Journal> Journal::open(const std::filesystem::path& path) {
  Journal journal;
  journal.path_ = path;
  journal.fd_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (journal.fd_ < 0) return journal_failure("open", path, errno);
  if (::flock(journal.fd_, LOCK_EX | LOCK_NB) != 0) {
    return fail(ErrorCode::refused,
                fmt::format("open journal '{}': another process is capturing into this session; "
                            "stop it first",
                            path.string()));
  }
  auto replay = replay_journal(path);
  if (!replay) return tl::unexpected(replay.error());
  if (replay->torn_tail) {
    if (::ftruncate(journal.fd_, static_cast<off_t>(replay->good_bytes)) != 0 ||
        ::fsync(journal.fd_) != 0) {
      return journal_failure("cut the torn tail of", path, errno);
    }
  }
  if (auto synced = sync_directory(path.parent_path()); !synced) {
    return tl::unexpected(synced.error());
  }
  journal.torn_tail_ = replay->torn_tail;
  journal.bytes_ = replay->good_bytes;
  journal.next_ = replay->events.size() + 1;
  journal.replayed_ = std::move(replay->events);
  return journal;
}

Journal::Journal(Journal&& other) noexcept { *this = std::move(other); }

Journal& Journal::operator=(Journal&& other) noexcept {
  if (this != &other) {
    if (fd_ >= 0) ::close(fd_);
    path_ = std::move(other.path_);
    fd_ = std::exchange(other.fd_, -1);
    next_ = other.next_;
    bytes_ = other.bytes_;
    torn_tail_ = other.torn_tail_;
    half_written_ = other.half_written_;
    replayed_ = std::move(other.replayed_);
  }
  return *this;
}

Journal::~Journal() {
  if (fd_ >= 0) ::close(fd_);
}

Result<JournalEvent> Journal::append(const std::string& event, ordered_json fields) {
  CHECK(fd_ >= 0);
  CHECK(fields.is_null() || fields.is_object());
  const std::string line = to_line(next_, event, fields);
  // What could not be taken back then is taken back now, or nothing is written.
  if (half_written_ && ::ftruncate(fd_, static_cast<off_t>(bytes_)) != 0)
    return journal_failure("take back a half-written line of", path_, errno);
  half_written_ = false;
  std::size_t done = 0;
  int number = 0;
  while (done < line.size() && number == 0) {
    const ssize_t n = ::write(fd_, line.data() + done, line.size() - done);
    if (n > 0) {
      done += static_cast<std::size_t>(n);
    } else if (n == 0) {
      number = ENOSPC;
    } else if (errno != EINTR) {
      number = errno;
    }
  }
  if (number == 0 && ::fsync(fd_) != 0) number = errno;
  if (number != 0) {
    // Half a line must not stand before a later whole one: take back what went in.
    half_written_ = ::ftruncate(fd_, static_cast<off_t>(bytes_)) != 0;
    return journal_failure("append to", path_, number);
  }
  bytes_ += line.size();
  return JournalEvent{next_++, event,
                      fields.is_null() ? ordered_json::object() : std::move(fields)};
}

}  // namespace lightrig
