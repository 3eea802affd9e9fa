#include "daemon/session/frame_store.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/check.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"

namespace lightrig {
namespace {

/// What is true of the moment, apart from the frame's own bytes, which equal scenes make equal.
std::string sidecar(const TakenFrame& taken) {
  const nlohmann::ordered_json json{{"frame_id", taken.frame.id},
                                    {"asked_s", taken.asked},
                                    {"applied_s", taken.frame.exposure},
                                    {"taken_at", taken.taken_at}};
  return json.dump(1) + "\n";
}

}  // namespace

std::string utc_now() {
  const auto now = std::chrono::system_clock::now();
  const auto ms =
      std::chrono::duration_cast<std::chrono::milliseconds>(now.time_since_epoch()).count() % 1000;
  return fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03d}Z",
                     fmt::gmtime(std::chrono::system_clock::to_time_t(now)), ms);
}

FrameStore::FrameStore(SessionFolder folder, SensorModel sensor)
    : folder_(std::move(folder)),
      sensor_(sensor),
      thread_([this](const std::stop_token& stop) { run(stop); }) {}

FrameStore::~FrameStore() = default;

void FrameStore::begin(std::vector<TakenFrame> frames) {
  {
    const std::lock_guard lock(mutex_);
    CHECK(frames_.empty() && !storing_);
    frames_ = std::move(frames);
    outcome_.reset();
    storing_ = true;
  }
  changed_.notify_all();
}

bool FrameStore::busy() const {
  const std::lock_guard lock(mutex_);
  return !frames_.empty();
}

Result<std::vector<StoredFrame>> FrameStore::collect(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  CHECK(!frames_.empty());
  if (!storing_ && !outcome_) {
    storing_ = true;
    changed_.notify_all();
  }
  if (!changed_.wait(lock, stop, [this] { return outcome_.has_value(); })) {
    return fail(ErrorCode::stopped, "stopped on request while frames were being stored");
  }
  Result<std::vector<StoredFrame>> result = std::move(*outcome_);
  outcome_.reset();
  if (result) frames_.clear();
  return result;
}

void FrameStore::run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (changed_.wait(lock, stop, [this] { return storing_; })) {
    lock.unlock();
    auto result = store();  // frames_ is ours alone while storing_
    lock.lock();
    outcome_ = std::move(result);
    storing_ = false;
    changed_.notify_all();
  }
}

Result<std::vector<StoredFrame>> FrameStore::store() const {
  std::vector<StoredFrame> stored;
  for (const TakenFrame& taken : frames_) {
    const std::filesystem::path path = folder_.root / taken.file;
    const auto bytes = encode_frame(taken.frame, sensor_, {taken.file, taken.role});
    if (!bytes) return tl::unexpected(with_context("store " + taken.file, bytes.error()));
    if (auto made = make_folder(path.parent_path()); !made) return tl::unexpected(made.error());
    if (auto written = write_durably(path, *bytes); !written) {
      return tl::unexpected(written.error());
    }
    std::filesystem::path beside = path;
    beside.replace_extension(".json");
    if (auto written = write_durably(beside, sidecar(taken)); !written) {
      return tl::unexpected(written.error());
    }
    stored.push_back({taken.file, taken.role, taken.frame.exposure, sha256_hex(*bytes)});
  }
  return stored;
}

}  // namespace lightrig
