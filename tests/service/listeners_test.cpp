#include "daemon/service/listeners.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>
#include <array>
#include <cctype>

#include <fstream>

#include "tests/service/scratch_folder.h"

namespace lightrig {
namespace {

using ::testing::HasSubstr;

TEST(UnixListener, MakesASocketForOwnerAndGroupAlone) {
  ScratchFolder folder;
  auto listener = UnixListener::open(folder.path() / "control.sock");
  ASSERT_TRUE(listener) << listener.error().message;
  struct stat facts {};
  ASSERT_EQ(stat((folder.path() / "control.sock").c_str(), &facts), 0);
  EXPECT_TRUE(S_ISSOCK(facts.st_mode));
  EXPECT_EQ(facts.st_mode & 07777, 0660U);
}

TEST(UnixListener, RefusesThePlaceOfALiveService) {
  ScratchFolder folder;
  const auto path = folder.path() / "control.sock";
  auto first = UnixListener::open(path);
  ASSERT_TRUE(first);
  auto second = UnixListener::open(path);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::refused);
  EXPECT_THAT(second.error().message, HasSubstr("in use by another lightrigd"));
}

TEST(UnixListener, ReplacesASocketThatNobodyAnswersBehind) {
  ScratchFolder folder;
  const auto path = folder.path() / "control.sock";
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.string().copy(address.sun_path, sizeof(address.sun_path) - 1);
  const void* raw = &address;
  {
    const FileDescriptor dead(socket(AF_UNIX, SOCK_STREAM, 0));
    ASSERT_EQ(bind(dead.get(), static_cast<const sockaddr*>(raw), sizeof address), 0);
  }
  ASSERT_TRUE(std::filesystem::exists(path)) << "a crash leaves the file behind";
  auto listener = UnixListener::open(path);
  ASSERT_TRUE(listener) << listener.error().message;
  const FileDescriptor client(socket(AF_UNIX, SOCK_STREAM, 0));
  EXPECT_EQ(connect(client.get(), static_cast<const sockaddr*>(raw), sizeof address), 0);
}

TEST(UnixListener, LeavesAFileThatIsNoSocketAlone) {
  ScratchFolder folder;
  const auto path = folder.path() / "control.sock";
  std::ofstream(path) << "precious";
  auto listener = UnixListener::open(path);
  ASSERT_FALSE(listener);
  EXPECT_THAT(listener.error().message, HasSubstr("is not a socket"));
  EXPECT_TRUE(std::filesystem::is_regular_file(path));
}

TEST(UnixListener, RemovesItsFileAtTheEndAndNobodyElses) {
  ScratchFolder folder;
  const auto path = folder.path() / "control.sock";
  {
    auto listener = UnixListener::open(path);
    ASSERT_TRUE(listener);
  }
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST(UnixListener, SaysWhenThePathIsTooLong) {
  ScratchFolder folder;
  auto listener = UnixListener::open(folder.path() / std::string(200, 'x'));
  ASSERT_FALSE(listener);
  EXPECT_THAT(listener.error().message, HasSubstr("a Unix socket's may have"));
}

TEST(LockFile, NamesTheProcessThatHoldsIt) {
  ScratchFolder folder;
  auto first = LockFile::take(folder.path() / "lock", "the session root");
  ASSERT_TRUE(first);
  auto second = LockFile::take(folder.path() / "lock", "the session root");
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error().message, HasSubstr("process " + std::to_string(getpid())));
}

TEST(LockFile, SaysHowToChooseAnotherPlaceWhereItCannotBeMade) {
  ScratchFolder folder;
  const auto nowhere = UnixListener::open(folder.path() / "absent" / "control.sock");
  ASSERT_FALSE(nowhere);
  EXPECT_THAT(nowhere.error().message, HasSubstr("--socket or $LIGHTRIG_SOCKET"));
}

TEST(TcpAddress, UnderstandsNumericHostsAndTellsLoopbackFromTheRest) {
  EXPECT_TRUE(parse_tcp_address("127.0.0.1:8080")->loopback);
  EXPECT_TRUE(parse_tcp_address("127.9.9.9:1")->loopback);
  EXPECT_TRUE(parse_tcp_address("[::1]:8080")->loopback);
  EXPECT_TRUE(parse_tcp_address(":8080")->loopback);
  EXPECT_FALSE(parse_tcp_address("0.0.0.0:8080")->loopback);
  EXPECT_FALSE(parse_tcp_address("[::]:8080")->loopback);
  EXPECT_FALSE(parse_tcp_address("192.168.1.7:8080")->loopback);
  EXPECT_EQ(parse_tcp_address("127.0.0.1:8080")->port, 8080);
}

TEST(TcpAddress, RefusesWhatIsNoAddress) {
  for (const char* text : {"", "8080", "localhost:8080", "127.0.0.1:", "127.0.0.1:99999",
                           "127.0.0.1:80x", "127.0.0.1:-1", "1.2.3:80"})
    EXPECT_FALSE(parse_tcp_address(text)) << text;
}

TEST(TcpAddress, IsAskedForByItsOwnAddressTheLoopbacksAndWhatIsSaid) {
  const auto fd = listen_tcp({"127.0.0.2", 0, true});
  ASSERT_TRUE(fd) << fd.error().message;
  const std::string port = ":" + std::to_string(bound_port(fd->get()));
  EXPECT_THAT(hosts_of(fd->get(), {"Rig.Lab", "fd00::7"}),
              ::testing::ElementsAre("localhost" + port, "127.0.0.1" + port, "[::1]" + port,
                                     "127.0.0.2" + port, "rig.lab" + port, "[fd00::7]" + port));
}

TEST(TcpAddress, BoundToAWildcardIsAskedForByTheMachinesAddressesAndName) {
  std::array<char, 256> name{};
  ASSERT_EQ(gethostname(name.data(), name.size() - 1), 0);
  std::string host = name.data();
  for (char& c : host) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  for (const char* wildcard : {"0.0.0.0", "::"}) {
    const auto fd = listen_tcp({wildcard, 0, false});
    if (!fd) continue;  // a machine without IPv6
    const std::string port = ":" + std::to_string(bound_port(fd->get()));
    const auto hosts = hosts_of(fd->get(), {});
    EXPECT_THAT(hosts, ::testing::Contains(host + port)) << wildcard;
    EXPECT_THAT(hosts, ::testing::Contains("127.0.0.1" + port)) << wildcard;
    EXPECT_THAT(hosts, ::testing::Not(::testing::Contains(std::string(wildcard) + port)));
  }
}

}  // namespace
}  // namespace lightrig
