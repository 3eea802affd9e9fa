#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace lightrig::campaign {

/// A kind of wire, the shipped rig file behind it, and what can go wrong on it
/// [docs/simulate.md].
struct WireKind {
  std::string name, rig_file;
  bool needs_umockdev = false;
  int stated_s = 0;  ///< by which every session with one fault has ended by itself [s]
  std::vector<std::string> effects;
};
const std::vector<WireKind>& wire_kinds();
const WireKind& wire_kind(const std::string& name);  ///< Ends the program for any other name.

/// What a session without a fault does, so that faults can be drawn from all of it.
struct Clean {
  std::uint64_t requests = 0, frames = 0, shots = 0, packets_lost = 0;
  double seconds = 0;
};

struct Trial {
  std::string wire, fault;  ///< as a fault script has it; "" for none
  std::uint64_t seed = 1;
};

/// The n-th fault of a campaign: wires and effects in turn, the moment and the measure drawn.
Trial draw(std::uint64_t seed, int n, const std::vector<WireKind>& kinds,
           const std::vector<Clean>& clean);

/// How a session ended.
struct Outcome {
  std::string verdict;  ///< "completed", "paused", "aborted" (faulted, or never armed), "died"
  std::string reason;   ///< what a person reads
  std::string phase;    ///< of the session, when the fault struck; "" when it never did
  std::vector<std::string> violations;  ///< what must not be, of wrong frames, lamp, motion, words
  int wrong_frames = 0, lamp_on_unsaid = 0, late = 0;
  Clean counts;
};

std::string to_json(const Outcome& outcome);
std::optional<Outcome> outcome_from(const std::string& json);

/// Runs one trial in this process, which must not have had one before and must end with it by
/// std::_Exit (the reduction of a completed session may still be computing): hosts the rig's wires,
/// starts the service on the same rig file, arms it, takes a session as a person would, and holds
/// what is stored against the laboratory's own record. Under LD_PRELOAD=libumockdev-preload.so.0
/// where the wire needs it. `patience` multiplies the wire's stated time.
Outcome run_trial(const Trial& trial, double patience = 1);

[[noreturn]] void die(const std::string& why);

}  // namespace lightrig::campaign
