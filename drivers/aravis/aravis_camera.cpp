#include <mutex>

#include "drivers/aravis/gv_session.h"
#include "drivers/backends.h"
#include "drivers/blocking_lane.h"

namespace lightrig {
namespace {

/// The camera as the session sees it: Aravis blocks on its own lane, the caller never does.
class AravisCameraDevice final : public Camera {
 public:
  AravisCameraDevice(const Rig& rig, Clock& clock) : rig_(rig), clock_(clock), lane_("camera") {}

  Result<void> open(const AravisCamera& backend, const Until& until) {
    auto opened = lane_.run(
        [this, backend](const std::stop_token&) -> Result<Frame> {
          auto session = GvSession::open(rig_, backend);
          if (!session) return tl::unexpected(session.error());
          const std::scoped_lock lock(mutex_);
          session_ = std::move(*session);
          counters_ = session_->counters();
          identity_ = session_->identity();
          return Frame{};
        },
        clock_, until);
    if (!opened) return tl::unexpected(opened.error());
    return {};
  }

  Result<Frame> expose(double seconds, const Until& until) override {
    return lane_.run(
        [this, seconds](const std::stop_token& stop) {
          Result<Frame> frame = session_->expose(seconds, stop);
          const CameraCounters counters = session_->counters();
          const std::scoped_lock lock(mutex_);
          counters_ = counters;
          return frame;
        },
        clock_, until);
  }

  CameraCounters counters() const override {
    const std::scoped_lock lock(mutex_);
    return counters_;
  }
  std::string identity() const override {
    const std::scoped_lock lock(mutex_);
    return identity_;
  }

 private:
  const Rig rig_;
  Clock& clock_;
  mutable std::mutex mutex_;
  CameraCounters counters_;
  std::string identity_;
  std::unique_ptr<GvSession> session_;  // touched on the lane only, once open
  BlockingLane<Frame> lane_;            // destroyed first: it uses the session
};

}  // namespace

Result<std::unique_ptr<Camera>> open_camera(const Rig& rig, const AravisCamera& backend,
                                            Clock& clock) {
  auto camera = std::make_unique<AravisCameraDevice>(rig, clock);
  // Discovery, a dozen registers at up to 2.5 s each when the camera dies half way.
  const Until until{clock.now() + std::chrono::seconds(30), {}};
  if (auto opened = camera->open(backend, until); !opened) return tl::unexpected(opened.error());
  return camera;
}

Backend aravis_backend() { return {"aravis", true, ""}; }

}  // namespace lightrig
