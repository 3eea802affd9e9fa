// What scripts/test demands of its machine, so that no wire goes untested without a word.
#include <gtest/gtest.h>

#include "drivers/backends.h"
#include "tests/drivers/own_network.h"

namespace lightrig {
namespace {

// What a skip would hide: scripts/test demands of its own build and machine what the wires need.
TEST(Demanded, EveryBackendIsBuiltAndANetworkOfItsOwnIsToBeHad) {
  if (!test::all_is_demanded()) GTEST_SKIP() << "LIGHTRIG_DEMAND_ALL is not set";
  for (const Backend& backend : backends()) EXPECT_TRUE(backend.built) << backend.remedy;
  EXPECT_EQ(test::enter_own_network(), "");
}

// A user namespace that allows no more of them stands for a machine that gives none.
TEST(Demanded, AMachineWithoutNetworkNamespacesFailsWhereAllIsDemandedAndSkipsWhereNot) {
  const auto without_namespaces = [](const char* demand) {
    setenv("LIGHTRIG_DEMAND_ALL", demand, 1);
    const uid_t uid = getuid();
    if (unshare(CLONE_NEWUSER) != 0) std::exit(77);
    std::ofstream("/proc/self/setgroups") << "deny";
    std::ofstream("/proc/self/uid_map") << "0 " << uid << " 1";
    std::ofstream("/proc/sys/user/max_net_namespaces") << "0";
    std::exit(test::enter_own_network().empty() ? 88 : 99);
  };
  EXPECT_EXIT(without_namespaces("1"), testing::ExitedWithCode(1),
              "no network namespace to be had");
  EXPECT_EXIT(without_namespaces(""), testing::ExitedWithCode(99), "");
}

}  // namespace
}  // namespace lightrig
