// tools/soak, tools/adverse and tools/bench as far as they can be tried without a trial, which
// would take long.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <string>

#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class SoakTest : public FilesTest {
 protected:
  int Bash(const std::string& arguments) const {
    const std::string command = "/bin/bash " + arguments + " > '" + Path("out") + "' 2>&1";
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  const std::string script_ = "'" LAMINA_SOURCE_DIR "/tools/soak'";
};

TEST_F(SoakTest, IsWellFormedAndExplainsItself) {
  EXPECT_EQ(Bash("-n " + script_), 0) << Bytes(Path("out"));
  EXPECT_EQ(Bash(script_ + " --help"), 0);
  EXPECT_THAT(Bytes(Path("out")), AllOf(HasSubstr("tools/soak kills"), HasSubstr("route"),
                                        HasSubstr("overload"), HasSubstr("latency")));
}

TEST_F(SoakTest, TheScriptForAdverseScenesExplainsItself) {
  const std::string script = "'" LAMINA_SOURCE_DIR "/tools/adverse'";
  EXPECT_EQ(Bash("-n " + script), 0) << Bytes(Path("out"));
  EXPECT_EQ(Bash(script + " --help"), 0);
  EXPECT_THAT(Bytes(Path("out")), AllOf(HasSubstr("promises/promises.md"), HasSubstr("--seeds 3"),
                                        HasSubstr("--random 50")));
}

TEST_F(SoakTest, TheScriptOfTheBenchExplainsItself) {
  const std::string script = "'" LAMINA_SOURCE_DIR "/tools/bench'";
  EXPECT_EQ(Bash("-n " + script), 0) << Bytes(Path("out"));
  EXPECT_EQ(Bash(script + " --help"), 0);
  EXPECT_THAT(Bytes(Path("out")), AllOf(HasSubstr("--against FILE"), HasSubstr("--kernels")));
  EXPECT_EQ(Bash(script + " --recordings"), 2);
  EXPECT_EQ(Bash(script + " --recordings '" + Path("none") + "'"), 1);
  EXPECT_THAT(Bytes(Path("out")), HasSubstr("no such folder"));
}

TEST_F(SoakTest, RefusesWhatItDoesNotKnow) {
  for (const char* arguments : {"", " swim", " kills none", " kills 0", " route 10 20"}) {
    EXPECT_EQ(Bash(script_ + arguments), 2) << arguments;
    EXPECT_THAT(Bytes(Path("out")), HasSubstr("tools/soak kills")) << arguments;
  }
}

}  // namespace
}  // namespace lamina
