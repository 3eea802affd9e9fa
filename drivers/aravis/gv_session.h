#pragma once

#include <arv.h>

#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "config/rig.h"
#include "drivers/aravis/gv_ref.h"
#include "drivers/devices.h"
#include "drivers/pixel_format.h"

namespace lightrig {

/// One control session with a GigE Vision camera. All calls may block for seconds (2.5 s per
/// register when the camera is dead): it lives on the driver's own lane. "The session is master":
/// every setting is written, then read back.
class GvSession {
 public:
  /// Opens, takes control, applies the rig's settings. Errors: not_found (nobody answers), refused
  /// (someone else controls it, a setting is not accepted), disconnected.
  static Result<std::unique_ptr<GvSession>> open(const Rig& rig, const AravisCamera& backend);
  ~GvSession();
  GvSession(const GvSession&) = delete;
  GvSession& operator=(const GvSession&) = delete;

  /// One whole frame at this exposure, or why not. `stop` is looked at every 5 ms while waiting for
  /// the frame.
  Result<Frame> expose(double seconds, const std::stop_token& stop);

  CameraCounters counters() const;
  const std::string& identity() const { return identity_; }

 private:
  GvSession(const Rig& rig, const AravisCamera& backend) : rig_(rig), backend_(backend) {}
  Result<void> connect();
  Result<void> load_user_set();
  bool is_named(const std::string& feature) const;
  Result<void> configure_features();
  Result<void> configure_format();
  Result<void> configure_region();
  Result<void> switch_automatics_off();
  Result<void> configure_fixed_settings();
  Result<void> configure_gain();
  Result<void> clear_triggers();
  Result<void> configure_trigger();
  Result<void> configure_witnesses();
  Result<void> open_stream();
  Result<void> create_stream();
  Result<void> prove_stream();
  Result<double> apply_exposure(double seconds);
  Result<Frame> take(double applied, const std::stop_token& stop);
  Result<void> trigger();
  Result<GRef<ArvBuffer>> wait_for_buffer(double seconds, const std::stop_token& stop);
  Result<Frame> accept(ArvBuffer* buffer, double exposure);
  Result<void> check_chunk(ArvBuffer* buffer, double exposure);
  Result<std::uint64_t> camera_time();
  Result<std::uint64_t> fresh_id(ArvBuffer* buffer);
  bool is_stale(ArvBuffer* buffer) const;
  tl::unexpected<Error> lost_or_failed(const std::string& doing, GError* error);
  void drop_stale_buffers();
  void return_buffer(GRef<ArvBuffer> buffer);

  const Rig& rig_;
  const AravisCamera backend_;
  GRef<ArvCamera> camera_;
  GRef<ArvStream> stream_;
  const PixelFormat* format_ = nullptr;
  std::string identity_;
  bool software_trigger_ = false;
  bool stream_for_each_start_ = false;  ///< it counts frames anew from every start
  bool lost_ = false;
  bool nothing_came_ = false;    ///< the last exposure's wait ended without any buffer
  GRef<ArvChunkParser> chunks_;  ///< null where the model says nothing of a frame's exposure
  std::string latch_command_, latch_value_;  ///< "" where the model's clock cannot be read
  bool has_temperature_ = false;             ///< watched, and the camera can tell
  bool check_latch_ = false;                 ///< the clock is still to be compared with a frame
  std::uint64_t triggered_at_ = 0;           ///< [ns] of the camera's clock, just before
  // Many cameras count frames anew from every start; ours only ever grows, so that a frame is known
  // by its id.
  std::uint64_t last_block_ = 0, id_offset_ = 0, last_timestamp_ = 0;
  CameraCounters counters_;
  std::int64_t resent_before_ = 0, lost_before_ = 0;  ///< what earlier streams add
};

}  // namespace lightrig
