#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "config/calibration_file.h"
#include "config/check_rig.h"
#include "config/descriptions.h"
#include "core/check.h"

namespace lightrig {
namespace {

std::chrono::milliseconds milliseconds(const Section& s, const std::string& key) {
  return std::chrono::milliseconds(s.integer(key));
}

// The place of a choice among its KeySpec's, for enumerations written down in the same order.
template <class E>
E chosen(const Section& s, const std::string& key) {
  const KeySpec* spec = find_key(*s.spec, key);
  const auto at = std::ranges::find(spec->choices, s.text(key));
  CHECK(at != spec->choices.end());
  return static_cast<E>(at - spec->choices.begin());
}

CameraModel make_camera_model(const Section& s) {
  CameraModel m;
  m.width = s.integer("width_px");
  m.height = s.integer("height_px");
  m.projection = chosen<CameraModel::Projection>(s, "projection");
  if (m.projection == CameraModel::Projection::perspective) {
    // What a calibration states is put in once its file is read; till then 1 stands for it.
    m.fx = s.has("fx_px") ? s.number("fx_px") : 1;
    m.fy = s.has("fy_px") ? s.number("fy_px") : m.fx;
    const std::vector<double> distortion = s.numbers("distortion");
    std::ranges::copy(distortion, m.distortion.begin());
  } else {
    m.fx = m.fy = s.number("scale_px_per_m");
  }
  // The centre of an image whose first pixel has its centre at 0.
  m.cx = s.has("cx_px") ? s.number("cx_px") : (m.width - 1) / 2.0;
  m.cy = s.has("cy_px") ? s.number("cy_px") : (m.height - 1) / 2.0;
  // A calibration may state the pose.
  if (s.has("eye_m"))
    m.camera_from_world = look_at(s.vector3("eye_m"), s.vector3("target_m"), s.vector3("up"));
  return m;
}

SensorModel make_sensor(const Section& s) {
  SensorModel m;
  m.filter = chosen<ColorFilter>(s, "filter");
  m.bits = s.integer("bits");
  m.gain = s.number("gain_e_per_dn");
  m.black_level = s.number("black_level_dn");
  m.read_noise = s.number("read_noise_e");
  m.dark_current = s.number("dark_current_e_per_s");
  m.full_well = s.number("full_well_e");
  m.response = s.channels("response_e_m2_sr_per_j");
  m.min_exposure = s.number("min_exposure_s");
  m.max_exposure = s.number("max_exposure_s");
  return m;
}

AravisCamera make_aravis(const Section& s) {
  AravisCamera c;
  c.id = s.text("id");
  c.interface_ip = s.text("interface_ip");
  c.pixel_format = s.text("pixel_format");
  c.trigger = s.text("trigger");
  c.packet_size = s.integer("packet_size_bytes");
  c.socket_buffer_bytes = s.integer("socket_buffer_bytes");
  c.packet_socket = s.boolean("packet_socket");
  c.port = s.integer("port");
  if (const Section* features = s.find("features"))
    c.features = {features->free_form.begin(), features->free_form.end()};
  return c;
}

CameraConfig make_camera(const Section& s) {
  CameraConfig c;
  c.model = make_camera_model(s);
  c.sensor = make_sensor(s.table("sensor"));
  c.readout_time = s.number("readout_ms");
  c.demosaic = s.table("sensor").boolean("demosaic");
  if (s.has("lens_cone_deg")) c.lens_cone = s.number("lens_cone_deg");
  // A stored session's rig may name a file that has gone; its copy is applied instead.
  if (s.given_key("calibration") && !apply_camera_calibration(s.file("calibration"), c))
    c.calibration = s.file("calibration");
  if (const Section* aravis = s.find("aravis")) c.backend = make_aravis(*aravis);
  return c;
}

std::variant<TcpEndpoint, SerialEndpoint> make_endpoint(const Section& s,
                                                        const ProfileSerial& line) {
  if (s.given_key("host")) return TcpEndpoint{s.text("host"), s.integer("port")};
  SerialEndpoint e;
  e.device = s.text("device");
  e.baud = s.has("baud") ? s.integer("baud") : line.baud;
  e.parity = line.parity;
  if (s.has("parity"))
    e.parity = s.text("parity") == "even" ? 'E' : s.text("parity") == "odd" ? 'O' : 'N';
  e.data_bits = s.has("data_bits") ? s.integer("data_bits") : line.data_bits;
  e.stop_bits = s.has("stop_bits") ? s.integer("stop_bits") : line.stop_bits;
  e.rs485 = s.has("rs485") && s.boolean("rs485");
  return e;
}

// The table that speaks of this axis.
const Section& of_axis(const std::vector<const Section*>& tables, const std::string& key,
                       const std::string& axis) {
  const auto at =
      std::ranges::find_if(tables, [&](const Section* t) { return t->text(key) == axis; });
  CHECK(at != tables.end());
  return **at;
}

// What a key of this axis is called: "min_deg" of a rotary one is "min_mm" of a linear one.
std::string in_unit_of(const std::string& axis, std::string rotary_key) {
  if (std::ranges::count(linear_axes(), axis) == 0) return rotary_key;
  for (auto at = rotary_key.find("deg"); at != std::string::npos; at = rotary_key.find("deg"))
    rotary_key = fmt::format("{}mm{}", rotary_key.substr(0, at), rotary_key.substr(at + 3));
  return rotary_key;
}

ModbusGantry make_modbus(const Section& s, const GantryModel& model,
                         const ControllerProfile* profile) {
  ModbusGantry g;
  g.profile = s.file("profile");
  if (profile != nullptr) g.controller = *profile;
  g.timeout = milliseconds(s, "timeout_ms");
  for (const Axis& of_model : model.axes) {
    const std::string& axis = of_model.name;
    const Section& drive = of_axis(s.all("drive"), "axis", axis);
    ModbusDrive d;
    d.axis = axis;
    d.unit = drive.integer("unit");
    d.endpoint = make_endpoint(drive, g.controller.serial);
    d.counts_per_si = drive.number(in_unit_of(axis, "counts_per_deg"));
    d.zero = drive.number(in_unit_of(axis, "zero_deg"));
    d.counts_per_rev = drive.has("counts_per_rev") ? drive.number("counts_per_rev") : 0;
    g.drives.push_back(std::move(d));
  }
  return g;
}

GrblEndpoint make_grbl_endpoint(const Section& s) {
  if (s.given_key("usb_vendor")) {
    UsbEndpoint e;
    e.vendor = s.integer("usb_vendor");
    e.product = s.integer("usb_product");
    e.serial = s.text("usb_serial");
    e.baud = s.integer("baud");
    return e;
  }
  SerialEndpoint e;
  e.device = s.text("device");
  e.baud = s.integer("baud");
  return e;
}

GrblGantry make_grbl(const Section& s, const GantryModel& model) {
  GrblGantry g;
  g.endpoint = make_grbl_endpoint(s);
  g.timeout = milliseconds(s, "timeout_ms");
  for (const Axis& of_model : model.axes) {
    const std::string& axis = of_model.name;
    const Section& one = of_axis(s.all("axis"), "axis", axis);
    g.letters.push_back(one.text("letter")[0]);
    g.units_per_si.push_back(one.number(in_unit_of(axis, "units_per_deg")));
  }
  return g;
}

Axis make_axis(const Section& s) {
  Axis a;
  a.name = s.text("name");
  const auto value = [&](const char* key) { return s.number(in_unit_of(a.name, key)); };
  a.rotary = std::ranges::count(linear_axes(), a.name) == 0;
  a.min = value("min_deg");
  a.max = value("max_deg");
  a.max_speed = value("max_speed_deg_per_s");
  a.max_acceleration = value("max_acceleration_deg_per_s2");
  a.home = value("home_deg");
  return a;
}

Kinematics make_kinematics(const Section& s) {
  const std::string& kind = s.text("kinematics");
  if (kind == "dome") return DomeKinematics{s.vector3("centre_m"), s.number("radius_m")};
  if (kind == "cartesian")
    return CartesianKinematics{s.vector3("origin_m"), s.vector3("lamp_direction").normalized(),
                               false, Eigen::Vector3d::Zero()};
  if (kind == "cartesian_aimed")
    return CartesianKinematics{s.vector3("origin_m"), -Eigen::Vector3d::UnitZ(), true,
                               s.vector3("centre_m")};
  if (kind == "lamps") return FixedLampsKinematics{s.vectors("lamps_m"), s.vector3("centre_m")};
  TurntableKinematics table;
  table.centre = s.vector3("centre_m");
  table.radius = s.number("radius_m");
  table.azimuth = s.number("lamp_azimuth_deg");
  table.elevation = s.has("lamp_elevation_deg") ? s.number("lamp_elevation_deg") : 0;
  table.arm = std::ranges::any_of(
      s.all("axis"), [](const Section* axis) { return axis->text("name") == "elevation"; });
  return table;
}

// Fixed lamps have one axis that nothing moves: which of them is lit.
Axis lamp_selector(std::size_t lamps) {
  Axis a;
  a.name = "lamp";
  a.rotary = false;
  a.selector = true;
  a.max = static_cast<double>(lamps) - 1;
  a.max_speed = a.max_acceleration = 1;
  return a;
}

std::vector<Axis> make_axes(const Section& s, const Kinematics& kinematics) {
  if (const auto* fixed = std::get_if<FixedLampsKinematics>(&kinematics))
    return {lamp_selector(fixed->lamps.size())};
  std::vector<Axis> axes;
  for (const std::string& name : axes_of_kinematics(s.text("kinematics"))) {
    const auto& tables = s.all("axis");
    const bool given =
        std::ranges::any_of(tables, [&](const Section* t) { return t->text("name") == name; });
    if (given) axes.push_back(make_axis(of_axis(tables, "name", name)));
  }
  return axes;
}

GantrySolid make_solid(const Section& s) {
  GantrySolid solid;
  solid.body.lamp_radius = s.number("lamp_radius_m");
  solid.body.boom_length = s.number("boom_length_m");
  solid.body.boom_radius = s.number("boom_radius_m");
  solid.body.boom_direction = s.vector3("boom_direction").normalized();
  if (s.has("mast_foot_m")) solid.body.mast_foot = s.vector3("mast_foot_m");
  solid.margin = s.number("margin_m");
  if (s.has("floor_m")) solid.floor = s.number("floor_m");
  solid.camera_radius = s.number("camera_radius_m");
  solid.camera_length = s.number("camera_length_m");
  return solid;
}

EmissionLobe make_lobe(const Section& lamp) {
  EmissionLobe lobe;
  if (lamp.text("kind") != "near") return lobe;
  if (lamp.text("emission") == "cosine_power") lobe.exponent = lamp.number("emission_exponent");
  if (lamp.text("emission") == "table") {
    lobe.angle = lamp.numbers("emission_angles_deg");
    lobe.intensity = lamp.numbers("emission_relative");
    const double on_axis = lobe.intensity.front();
    for (double& value : lobe.intensity) value /= on_axis;
  }
  return lobe;
}

GantryConfig make_gantry(const Section& s, const Section& lamp, const ControllerProfile* profile) {
  GantryConfig g;
  g.model.kinematics = make_kinematics(s);
  g.model.axes = make_axes(s, g.model.kinematics);
  g.model.distant_lamp = lamp.text("kind") == "distant";
  g.model.lobe = make_lobe(lamp);
  g.model.settle_time = s.number("settle_s");
  if (s.has("tolerance_deg")) g.model.tolerance = s.number("tolerance_deg");
  if (s.has("tolerance_mm")) g.model.linear_tolerance = s.number("tolerance_mm");
  if (const Section* body = s.find("body")) g.solid = make_solid(*body);
  g.move_time_factor = s.number("move_time_factor");
  g.move_time_margin = milliseconds(s, "move_time_margin_ms");
  g.homing_timeout = milliseconds(s, "homing_timeout_ms");
  if (const Section* modbus = s.find("modbus")) g.backend = make_modbus(*modbus, g.model, profile);
  if (const Section* grbl = s.find("grbl")) g.backend = make_grbl(*grbl, g.model);
  if (s.text("backend") == "lamps") g.backend = FixedLampsGantry{};
  return g;
}

LampConfig make_lamp(const Section& s) {
  LampConfig l;
  l.strength = s.channels(s.text("kind") == "near" ? "strength_w_per_sr" : "strength_w_per_m2");
  l.absolute_scale = s.boolean("absolute_scale");
  if (s.given_key("white_reference")) {
    l.white_reference = s.file("white_reference");
    l.absolute_scale = true;
    (void)apply_white_reference(l.white_reference, s.text("kind") == "near", l);
  }
  l.max_power = s.number("max_power");
  l.power = s.number("power");
  l.warm_up = s.number("warm_up_s");
  l.max_on_time = std::chrono::milliseconds(std::llround(s.number("max_on_time_s") * 1000));
  if (const Section* wired = s.find("gantry")) l.backend = GantryLamp{wired->text("output")};
  if (const Section* modbus = s.find("modbus")) {
    ModbusLamp m;
    m.endpoint = make_endpoint(*modbus, ProfileSerial{});
    m.unit = modbus->integer("unit");
    if (modbus->has("coil")) m.coil = modbus->integer("coil");
    if (modbus->has("holding")) m.holding = modbus->integer("holding");
    if (modbus->has("full_scale")) m.full_scale = modbus->integer("full_scale");
    if (modbus->has("temperature")) m.temperature = modbus->integer("temperature");
    if (m.temperature) m.degrees_per_count = modbus->number("temperature_c_per_count");
    m.timeout = milliseconds(*modbus, "timeout_ms");
    l.backend = std::move(m);
  }
  if (const Section* grbl = s.find("grbl"))
    l.backend = GrblLamp{make_grbl_endpoint(*grbl), grbl->text("output")};
  return l;
}

PauseRule make_pause_rule(const Section& s, const std::string& unit, double si = 1) {
  return {si * s.number("pause_above" + unit), si * s.number("resume_below" + unit),
          s.boolean("resume_by_itself")};
}

PauseConditions make_pause(const Section& s) {
  PauseConditions p;
  p.wrong_pose = s.boolean("wrong_pose");
  if (const Section* loss = s.find("packet_loss"))
    p.packet_loss = {make_pause_rule(*loss, "_per_frame"), loss->integer("over_frames")};
  if (const Section* drift = s.find("lamp_drift"))
    p.lamp_drift = {make_pause_rule(*drift, "_percent", 0.01), drift->integer("every_lights"),
                    drift->number("recheck_minutes")};
  if (const Section* lamp = s.find("lamp_temperature"))
    p.lamp_temperature = make_pause_rule(*lamp, "_c");
  if (const Section* camera = s.find("camera_temperature"))
    p.camera_temperature = make_pause_rule(*camera, "_c");
  return p;
}

KeepOut make_keep_out(const Section& s) {
  if (s.text("shape") == "sphere")
    return KeepOutSphere{s.name, s.vector3("centre_m"), s.number("radius_m")};
  return KeepOutBox{s.name, s.vector3("min_m"), s.vector3("max_m")};
}

CandidateRule make_candidates(const Section& s) {
  CandidateRule r;
  r.kind = chosen<CandidateRule::Kind>(s, "rule");
  if (r.kind == CandidateRule::Kind::fibonacci) {
    r.count = s.integer("count");
    r.centre = s.vector3("sphere_centre_m");
    if (s.has("sphere_radius_m")) r.radius = s.number("sphere_radius_m");
  }
  if (r.kind == CandidateRule::Kind::list) r.list = s.vectors("positions_m");
  if (r.kind == CandidateRule::Kind::grid) r.steps = s.integers("steps");
  return r;
}

SimulationConfig make_simulation(const Section& s) {
  SimulationConfig c;
  const std::string& material = s.text("material");
  c.material = names_a_file(material) ? s.file("material").string() : material;
  c.seed = s.seed("seed");
  c.clock_rate = s.number("clock_rate");
  c.arm_frequency = s.number("arm_frequency_hz");
  c.arm_damping = s.number("arm_damping");
  c.pose_error = s.number("pose_error_deg");
  c.lamp_position_error = s.number("lamp_position_error_mm");
  if (s.has("obstacle_m")) c.obstacle = s.vector3("obstacle_m");
  c.obstacle_radius = s.number("obstacle_radius_mm");
  c.ambient = s.channels("ambient_w_per_m2_sr");
  c.lamp_drift = 0.01 / 3600 * s.number("lamp_drift_percent_per_hour");
  return c;
}

}  // namespace

bool names_a_file(const std::string& material) {
  return material.find('/') != std::string::npos || material.ends_with(".binary");
}

Rig make_rig(const Section& root, const ControllerProfile* profile) {
  Rig rig;
  rig.name = root.table("rig").text("name");
  rig.session_root = root.table("rig").file("session_root");
  rig.camera = make_camera(root.table("camera"));
  rig.gantry = make_gantry(root.table("gantry"), root.table("lamp"), profile);
  rig.lamp = make_lamp(root.table("lamp"));
  for (const Section* s : root.all("interlocks"))
    rig.interlocks.push_back({s->name, s->text("input"), s->boolean("resume_by_itself")});
  if (const Section* s = root.find("pause")) rig.pause = make_pause(*s);
  for (const Section* s : root.all("keep_out")) rig.keep_out.push_back(make_keep_out(*s));
  rig.candidates = make_candidates(root.table("candidates"));
  if (const Section* s = root.find("simulation")) rig.simulation = make_simulation(*s);
  return rig;
}

}  // namespace lightrig
