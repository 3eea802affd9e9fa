// A service that dies in the middle of a session, as the person sees it who waits for the session.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <string>

#include "tests/cli/running_service.h"

namespace lightrig {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class Crash : public RunningService {};

TEST_F(Crash, IsTakenForWhatItIsAndLeavesASessionThatCanBeResumed) {
  begin_service("5");
  FILE* waiting = begin("start --wait");
  std::string text;
  std::array<char, 4096> line{};
  while (std::fgets(line.data(), line.size(), waiting) != nullptr) {
    text += line.data();
    if (text.find(" 1/") != std::string::npos) kill_service();  // one light is done
  }
  EXPECT_NE(pclose(waiting), 0);
  const auto id = text.substr(8, text.find('\n') - 8);  // "session ID"
  EXPECT_THAT(text, HasSubstr("the service ended during session " + id));
  EXPECT_THAT(text, HasSubstr("lightrig resume " + id));
  EXPECT_THAT(text, Not(HasSubstr("no lightrigd answers")));

  begin_service("5");
  EXPECT_THAT(lightrig("status"), HasSubstr("unfinished " + id + ": interrupted after "));
  EXPECT_THAT(lightrig("sessions"), HasSubstr("lights; lightrig resume " + id));
}

}  // namespace
}  // namespace lightrig
