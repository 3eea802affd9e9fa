#include "daemon/session/frame_store.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "config/json_text.h"
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
  return json_text(json, 1) + "\n";
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

void FrameStore::add(TakenFrame frame) {
  {
    const std::lock_guard lock(mutex_);
    CHECK(!storing_ && !outcome_);
    frames_.push_back(std::move(frame));
  }
  changed_.notify_all();
}

void FrameStore::drop() {
  std::unique_lock lock(mutex_);
  CHECK(!storing_ && !outcome_);
  changed_.wait(lock, [this] { return !busy_; });
  frames_.clear();
  encoded_.clear();
}

void FrameStore::begin() {
  {
    const std::lock_guard lock(mutex_);
    CHECK(!frames_.empty() && !storing_);
    outcome_.reset();
    storing_ = true;
  }
  changed_.notify_all();
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
  if (result) {
    frames_.clear();
    encoded_.clear();
  }
  return result;
}

void FrameStore::run(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  const auto work = [this] { return storing_ || encoded_.size() < frames_.size(); };
  while (changed_.wait(lock, stop, work)) {
    busy_ = true;
    if (encoded_.size() < frames_.size()) {
      if (stop.stop_requested() && !storing_) return;  // a shot that never became whole
      const TakenFrame& taken = frames_[encoded_.size()];
      lock.unlock();
      Encoded bytes = encode_frame(taken.frame, sensor_, {taken.file, taken.role});
      lock.lock();
      encoded_.push_back(std::move(bytes));
    } else {
      lock.unlock();
      auto result = store();  // nobody adds or drops while storing_
      lock.lock();
      outcome_ = std::move(result);
      storing_ = false;
    }
    busy_ = false;
    changed_.notify_all();
  }
}

Result<std::vector<StoredFrame>> FrameStore::store() const {
  std::vector<StoredFrame> stored;
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    const TakenFrame& taken = frames_[i];
    const Encoded& bytes = encoded_[i];
    const std::filesystem::path path = folder_.root / taken.file;
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
