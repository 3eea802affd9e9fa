#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <stop_token>
#include <thread>

#include "core/image.h"
#include "drivers/clock.h"
#include "sim/aravis/camera_registers.h"
#include "sim/aravis/gvsp_stream.h"

namespace lightrig::sim {

/// What the sensor sees: a frame of the scene as it is at the moment of the call, at this exposure
/// [s].
using Sensor = std::function<Result<Frame>(double exposure, const std::stop_token&)>;

/// How and where the next frame goes, and the camera's time at its beginning.
struct Shot {
  CaptureSettings settings;
  StreamTarget target;
  std::uint64_t timestamp = 0;
};

/// Takes frames on a thread of its own: waits for the trigger, exposes as long as the clock says,
/// reads out, hands over to the stream. Starting, stopping and triggering return at once.
class Acquisition {
 public:
  /// `next_shot` is asked at the beginning of every exposure; `accident` is told of faults that
  /// befall the camera rather than the frame. Neither is called with a lock of this class held.
  struct Owner {
    std::function<Shot()> next_shot;
    std::function<void(const CameraFault&)> accident;
  };

  Acquisition(const CameraBody& body, Sensor sensor, Clock& clock, GvspStream& stream,
              CameraWireFaults& faults, Owner owner);
  ~Acquisition();
  Acquisition(const Acquisition&) = delete;
  Acquisition& operator=(const Acquisition&) = delete;

  void start();
  void stop();     ///< ends the exposure in progress; its frame never comes
  void trigger();  ///< ignored unless started and waiting for one, as cameras do

 private:
  void work(const std::stop_token& stop);
  bool wait_for_trigger(const std::stop_token& run);
  void take(const Shot& shot, const std::stop_token& run);
  bool survives(const std::vector<CameraFault>& struck);
  std::vector<std::uint8_t> encode(const Frame& frame, const Shot& shot, double exposure,
                                   int rows) const;

  const CameraBody body_;
  const Sensor sensor_;
  Clock& clock_;
  GvspStream& stream_;
  CameraWireFaults& faults_;
  const Owner owner_;
  WireFrame last_;  // on the thread only
  std::uint64_t taken_ = 0;

  std::mutex mutex_;
  std::condition_variable_any woken_;
  std::stop_source run_;
  bool running_ = false, armed_ = false, triggered_ = false;
  std::jthread thread_;  // last
};

}  // namespace lightrig::sim
