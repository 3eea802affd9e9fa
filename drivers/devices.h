#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/gantry_model.h"
#include "core/image.h"
#include "core/result.h"
#include "drivers/clock.h"

namespace lightrig {

struct Rig;

/// What the gantry says of itself.
struct GantryStatus {
  GantryPosition position;
  bool homed = false;
  bool at_rest = false;
  std::string alarm;  ///< empty when there is none; else code and text
  std::vector<std::string>
      open_interlocks;  ///< names of inputs that forbid motion (door, e-stop chain)
};

/// Carries the lamp. Every call is one attempt that ends by success, failure, deadline or stop;
/// destroying the object stops the motion. Errors: disconnected, timed_out, refused, stopped.
class Gantry {
 public:
  virtual ~Gantry() = default;
  virtual Result<void> home(const Until& until) = 0;
  /// Returns at rest within tolerance, or failed and already told to stop.
  virtual Result<void> move_to(const GantryPosition& position, const Until& until) = 0;
  virtual Result<GantryStatus> status(const Until& until) = 0;
  virtual Result<void> clear_fault(const Until& until) = 0;
};

/// What the lamp says of itself.
struct LampState {
  double power = 0;        ///< [0, 1] as commanded and, where it can be read, as read back
  bool confirmed = false;  ///< read back from the device rather than remembered
  std::optional<double> temperature_c;  ///< where the lamp has a sensor
};

/// The lamp. A lease: it ends dark when the object is destroyed.
class Lamp {
 public:
  virtual ~Lamp() = default;
  virtual Result<void> set(double power, const Until& until) = 0;
  virtual Result<LampState> state(const Until& until) = 0;
};

/// Counters a camera keeps of its stream, and what it says of itself beside.
struct CameraCounters {
  std::uint64_t frames = 0, rejected = 0, packets_resent = 0, packets_lost = 0;
  std::optional<double> temperature_c;  ///< as read last, where the camera has a sensor
};

/// The camera: a whole frame taken at this exposure, or an error; never a doubtful frame.
class Camera {
 public:
  virtual ~Camera() = default;
  virtual Result<Frame> expose(double seconds, const Until& until) = 0;
  virtual CameraCounters counters() const = 0;
  /// Vendor, model, serial, firmware: one line for the record.
  virtual std::string identity() const = 0;
};

/// The opened rig. Destroyed in the order lamp, gantry, camera: dark first.
struct Devices {
  std::unique_ptr<Camera> camera;
  std::unique_ptr<Gantry> gantry;
  std::unique_ptr<Lamp> lamp;
};

/// Opens the hardware that the rig file names, and nothing else.
Result<Devices> open_devices(const Rig& rig, Clock& clock);
/// What came of opening one of a rig's devices.
struct TriedDevice {
  std::string device;   ///< "gantry", "lamp", "camera"
  std::string answer;   ///< what it says of itself, where it says anything
  std::string problem;  ///< "open gantry: …", why it could not be; "" when it was
};
/// Opens the rig's three devices, each whether or not the others open, and gives them back: nothing
/// moves, no lamp is lit.
std::vector<TriedDevice> try_devices(const Rig& rig, Clock& clock);
/// The rig's camera alone.
Result<std::unique_ptr<Camera>> open_camera(const Rig& rig, Clock& clock);
/// Whether the lamp can be lost and opened by itself: it shares neither controller nor wire with
/// the gantry.
bool lamp_has_own_wire(const Rig& rig);
/// Such a lamp alone.
Result<std::unique_ptr<Lamp>> open_lamp(const Rig& rig, Clock& clock);

/// A camera that answered discovery.
struct FoundCamera {
  std::string id;       ///< what [camera.aravis] id may say, besides the address and the serial
  std::string address;  ///< IPv4
  std::string serial;
  std::string hardware_address;  ///< MAC
  std::string obstacle;          ///< what would keep this process from receiving; "" nothing known
};

/// The GigE Vision cameras on this host's networks. Takes a second, takes control of none. Errors:
/// not_built.
Result<std::vector<FoundCamera>> find_cameras();

/// What this build contains: one line per backend, with the remedy where it is absent.
struct Backend {
  std::string name;  ///< "modbus", "usb", "aravis"
  bool built = false;
  std::string remedy;  ///< how to get it, where it is not built
};
std::vector<Backend> backends();

}  // namespace lightrig
