#pragma once

#include <chrono>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "config/controller_profile.h"
#include "config/session_spec.h"
#include "core/camera_model.h"
#include "core/gantry_model.h"
#include "core/keep_out.h"
#include "core/sensor.h"

namespace lightrig {

// --- camera backends
// -------------------------------------------------------------------------------------------------

/// A GigE Vision camera through Aravis.
struct AravisCamera {
  std::string id;  ///< IPv4 address, or Aravis id, serial number or MAC to be searched for
  std::string interface_ip;  ///< optional: the host's address to use; "" lets Aravis choose
  std::string
      pixel_format;  ///< e.g. "Mono12", "BayerRG12Packed"; "" derives it from filter and bits
  std::string trigger = "single_frame";  ///< "single_frame" or "software"
  int packet_size = 0;                   ///< [byte], 0 negotiates
  int socket_buffer_bytes = 8 << 20;
  bool packet_socket = false;
  int port = 3956;  ///< GVCP port: the standard's, and the only one that Aravis asks
  std::map<std::string, std::string>
      features;  ///< GenICam features set after opening, in name order
};
/// A camera that exists only in memory (--simulate); a real run refuses it.
struct SimulatedCamera {};
using CameraBackend = std::variant<SimulatedCamera, AravisCamera>;

/// What a file that a calibration wrote says of itself; empty for none.
struct CalibrationMark {
  std::string file, date, sha256;  ///< its name without its folder; its seal
  double sigma = 0;  ///< a white reference: of the strength, relative; a lens: of fx [px]

  bool given() const { return !sha256.empty(); }
};

struct CameraConfig {
  CameraModel model;
  SensorModel sensor;
  CameraBackend backend;
  bool demosaic = false;  ///< Bayer: every colour at every pixel rather than each at its own sites
  std::optional<double> lens_cone;    ///< [rad] about the line of sight: a lamp within shines into
                                      ///< the lens; absent: half the diagonal of view and 5°
  double readout_time = 0;            ///< [s] from end of exposure to frame in hand
  std::filesystem::path calibration;  ///< file the model was read from, "" if given inline
  CalibrationMark calibration_mark;   ///< of that file
};

// --- gantry backends
// -------------------------------------------------------------------------------------------------

struct TcpEndpoint {
  std::string host;
  int port = 502;
};
struct SerialEndpoint {
  std::string device;  ///< e.g. /dev/ttyUSB0
  int baud = 115200;
  char parity = 'N';
  int data_bits = 8, stop_bits = 1;
  bool rs485 = false;
};
/// One drive on a Modbus bus: which axis it moves.
struct ModbusDrive {
  std::string axis;
  int unit = 1;
  std::variant<TcpEndpoint, SerialEndpoint> endpoint;
  double counts_per_si = 0;   ///< drive counts per radian (or metre); negative turns the sense
  double zero = 0;            ///< [rad] or [m]: axis position where the drive says 0 counts
  double counts_per_rev = 0;  ///< of the motor; 0 where the profile needs none
};
/// A gantry whose drives speak Modbus as a controller profile describes.
struct ModbusGantry {
  std::filesystem::path profile;    ///< resolved path of config/controllers/NAME.toml
  ControllerProfile controller;     ///< what that file says
  std::vector<ModbusDrive> drives;  ///< one per axis, in axis order
  std::chrono::milliseconds timeout{500};
};
struct UsbEndpoint {
  int vendor = 0, product = 0;
  std::string serial;  ///< "" takes the only one, refuses if there are several
  int baud = 115200;
};
using GrblEndpoint = std::variant<UsbEndpoint, SerialEndpoint>;
/// A gantry behind a GRBL 1.1 or grblHAL controller, over libusb or a tty.
struct GrblGantry {
  GrblEndpoint endpoint;
  std::vector<char> letters;         ///< (axes) G-code letter per axis
  std::vector<double> units_per_si;  ///< (axes) GRBL millimetres (or degrees) per metre (or radian)
  std::chrono::milliseconds timeout{1000};
};
/// Fixed lamps on the coils of the lamp's own Modbus unit, the first on LampConfig's coil: "moving"
/// is choosing which one the lamp's power goes to.
struct FixedLampsGantry {};
struct SimulatedGantry {};
using GantryBackend = std::variant<SimulatedGantry, ModbusGantry, GrblGantry, FixedLampsGantry>;

/// What is solid about the rig: the moving parts, and what they must not touch besides the
/// keep-out volumes.
struct GantrySolid {
  GantryBody body;
  double margin = 0;            ///< [m] least distance that lamp and arm keep from anything
  std::optional<double> floor;  ///< [m] height of the floor, or of the table
  double camera_radius = 0;     ///< [m] of a barrel about the line of sight, 0 for none …
  double camera_length = 0;     ///< [m] … from the camera's centre backwards
};

/// What a person should hear where a lamp that hardware moves has no solid.
inline constexpr const char* no_body_remark =
    "the gantry moves without a [gantry.body]: the lamp is taken for a point and the arm for "
    "nothing, and object, camera and floor are no obstacles on its way; describe what is solid";

struct GantryConfig {
  GantryModel model;
  std::optional<GantrySolid> solid;  ///< absent: the lamp is a point
  GantryBackend backend;
  /// Deadline of a move = predicted move time × move_time_factor + move_time_margin.
  double move_time_factor = 1.5;
  std::chrono::milliseconds move_time_margin{2000};
  std::chrono::milliseconds homing_timeout{60000};
};

// --- lamp
// ------------------------------------------------------------------------------------------------------------

/// Switched by the gantry's own controller: a Modbus digital output of its profile, or GRBL's
/// spindle or coolant.
struct GantryLamp {
  std::string output;  ///< output name of the profile, or "spindle" / "flood" / "mist"
};
/// A coil or holding register of its own Modbus unit.
struct ModbusLamp {
  std::variant<TcpEndpoint, SerialEndpoint> endpoint;
  int unit = 1;
  std::optional<int> coil;         ///< either a coil (on/off) …
  std::optional<int> holding;      ///< … or a register
  int full_scale = 1;              ///< register value of power 1
  std::optional<int> temperature;  ///< holding register of its temperature, a signed count
  double degrees_per_count = 0;    ///< [°C]
  std::chrono::milliseconds timeout{500};
};
/// An output of a GRBL 1.1 or grblHAL controller of its own, which moves nothing.
struct GrblLamp {
  GrblEndpoint endpoint;
  std::string output;  ///< "spindle" / "flood" / "mist"
};
struct SimulatedLamp {};
using LampBackend = std::variant<SimulatedLamp, GantryLamp, ModbusLamp, GrblLamp>;

struct LampConfig {
  Eigen::Array3d strength =
      Eigen::Array3d::Ones();  ///< [W/sr] near, [W/m²] distant, per channel, at power 1
  bool absolute_scale =
      false;  ///< strength and response are calibrated; else the result's scale is nominal
  std::filesystem::path
      white_reference;         ///< file that the strength was read from, "" if given inline
  CalibrationMark white_mark;  ///< of that file
  double max_power = 0;        ///< [0, 1] no default: the most any command may ask for
  double power = 0;            ///< [0, 1] used for capture
  double warm_up = 0;          ///< [s] on before the first exposure
  std::chrono::milliseconds max_on_time{
      0};  ///< the lease: dark after this long without renewal; no default
  LampBackend backend;
};

// --- the rest
// --------------------------------------------------------------------------------------------------------

/// An input that forbids motion while open.
struct Interlock {
  std::string name;
  std::string input;  ///< input name of the controller profile
  bool resume_by_itself = false;
};

/// What pauses a running session, and when it may go on: between the two bounds nothing changes, so
/// that a reading on the edge does not make it stop and go.
struct PauseRule {
  double pause_above = 0;
  double resume_below = 0;  ///< ≤ pause_above
  bool resume_by_itself = false;
};
/// Packets that the camera lost or had to send again, mean per frame over the last frames.
struct PacketLossRule {
  PauseRule rule;  ///< [packets/frame]
  int over_frames = 20;
};
/// The lamp's light on the first light's scene, looked at again every so many lights.
struct LampDriftRule {
  PauseRule rule;  ///< [1] share by which the light has changed, up or down
  int every_lights = 5;
  double recheck = 300;  ///< [s] between two looks while paused for it
};
/// The conditions a rig is watched for; one that the rig file does not name is not.
struct PauseConditions {
  std::optional<PacketLossRule> packet_loss;
  std::optional<LampDriftRule> lamp_drift;
  std::optional<PauseRule> lamp_temperature, camera_temperature;  ///< [°C]
  bool wrong_pose = false;  ///< the object is not where the rig file has it
};

/// Where lamp and arm may not go. Shapes in the world frame [m].
struct KeepOutSphere {
  std::string name;
  Eigen::Vector3d centre;
  double radius = 0;
};
struct KeepOutBox {
  std::string name;
  Eigen::Vector3d min, max;
};
using KeepOut = std::variant<KeepOutSphere, KeepOutBox>;

/// How candidate light positions are laid out before the gantry's reach is asked.
struct CandidateRule {
  enum class Kind : std::uint8_t { fibonacci, list, grid } kind = Kind::fibonacci;
  int count = 1000;   ///< fibonacci: over the whole sphere of directions
  double radius = 0;  ///< [m] of that sphere, for linear axes …
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< … and its centre [m]
  std::vector<Eigen::Vector3d> list;  ///< [m] positions, or directions for a distant lamp
  std::vector<int> steps;             ///< grid: values per axis, evenly over its travel
};

/// What --simulate and `lightrig simulate` make of this rig; a real run never reads it.
struct SimulationConfig {
  std::string material =
      "";  ///< name in the built-in set, or path of a MERL file; required to simulate
  std::uint64_t seed = 1;
  double clock_rate = 1;           ///< ≥ 1; infinity jumps
  double arm_frequency = 0;        ///< [Hz] of the lightly damped arm; 0 = rigid
  double arm_damping = 0.05;       ///< ratio
  double pose_error = 0;           ///< [rad] rotation of the real object against the modelled one
  double lamp_position_error = 0;  ///< [m] rms, fixed per position
  std::optional<Eigen::Vector3d> obstacle;          ///< [m] centre of a ball that no model knows of
  double obstacle_radius = 0.01;                    ///< [m]
  Eigen::Array3d ambient = Eigen::Array3d::Zero();  ///< [W m⁻² sr⁻¹] seen with the lamp off
  double lamp_drift = 0;  ///< [1/s] by which the lamp brightens, of what it first gave
};

/// A rig, complete and valid: config yields no other.
struct Rig {
  std::string name;
  CameraConfig camera;
  GantryConfig gantry;
  LampConfig lamp;
  std::vector<Interlock> interlocks;
  PauseConditions pause;
  std::vector<KeepOut> keep_out;
  CandidateRule candidates;
  std::optional<SimulationConfig> simulation;
  std::filesystem::path session_root;  ///< where sessions are stored
  SessionSpec session_defaults;        ///< tables of a session that the rig file may hold
  std::filesystem::path path;          ///< of the rig file
  std::string text;                    ///< its exact bytes, copied into every session
};

}  // namespace lightrig
