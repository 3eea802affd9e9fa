#pragma once

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

namespace lightrig::test {

constexpr const char* umockdev_preload = "libumockdev-preload.so.0";

/// An emulated USB device is seen only by a program that runs under umockdev's preload library.
inline bool in_umockdevs_bed() {
  const char* loaded = std::getenv("LD_PRELOAD");
  return loaded != nullptr && std::string(loaded).find("umockdev") != std::string::npos;
}

/// Runs the current test in a process of its own under it.
inline void pass_in_umockdevs_bed() {
  const auto* info = testing::UnitTest::GetInstance()->current_test_info();
  const std::string self = std::filesystem::read_symlink("/proc/self/exe").string();
  FILE* pipe = popen(fmt::format("LD_PRELOAD={} timeout 280 {} --gtest_filter={}.{} 2>&1",
                                 umockdev_preload, self, info->test_suite_name(), info->name())
                         .c_str(),
                     "r");
  ASSERT_NE(pipe, nullptr);
  std::string out;
  std::array<char, 4096> buffer{};
  for (std::size_t n = 0; (n = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
    out.append(buffer.data(), n);
  const int status = pclose(pipe);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << out;
  EXPECT_THAT(out, testing::HasSubstr("[  PASSED  ] 1 test")) << "it did not run";
}

}  // namespace lightrig::test
