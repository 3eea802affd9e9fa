// Any bytes as a journal: replayed, understood, and appended to. What could be replayed can be
// replayed after that, and has one event more: an append that damages what stands is a crash here.
#include <cstdlib>

#include "daemon/session/journal.h"
#include "daemon/session/session_folder.h"
#include "tests/fuzz/scratch_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace lightrig;
  const std::string& path = fuzz::scratch_file("journal.jsonl", data, size);
  const auto replay = replay_journal(path);
  if (!replay) return 0;
  (void)captured_of(replay->events);
  {
    auto journal = Journal::open(path);
    if (!journal || !journal->append("note", {{"text", "\xff\n"}})) std::abort();
  }
  const auto again = replay_journal(path);
  if (!again || again->torn_tail || again->events.size() != replay->events.size() + 1) std::abort();
  return 0;
}
