#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "config/rig.h"

namespace lightrig {

/// Whether one device of a rig is there, found out without opening it.
struct Reach {
  std::string device;  ///< "camera 192.168.10.30", "serial /dev/ttyUSB0", "usb 1a86:7523"
  bool there = false;
  std::string said;  ///< what it answered, or why it cannot be opened and what to do
};

/// Looks for a rig's devices, each once, opening none: nothing moves, nothing is taken from whoever
/// holds one. A camera is asked by GigE Vision's discovery, which it answers to anybody, also while
/// another program controls it; a serial port and a USB device must stand where the system lists
/// them, and be this user's to open. A Modbus wire is not looked at: many a gateway has one
/// connection to give, and would take it from whoever steers with it. Takes no longer than
/// `patience`, for a camera that does not answer.
std::vector<Reach> reach_of(const Rig& rig, std::chrono::milliseconds patience);

}  // namespace lightrig
