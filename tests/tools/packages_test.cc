// tools/packages among programs that only say what they were called with: nothing is installed.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::SizeIs;

class PackagesTest : public FilesTest {
 protected:
  PackagesTest() {
    fs::create_directories(Path("bin"));
    fs::create_symlink("/usr/bin/env", Path("bin/env"));
    Fake("id", "echo 0");
    // Packages that were removed but not purged have a state, too: it is not "installed".
    Fake("dpkg-query", R"(package="${*: -1}"
      case " $ABSENT " in *" $package "*) exit 1 ;; esac
      case " $REMOVED " in *" $package "*) printf config-files ;; *) printf installed ;; esac)");
    Fake("apt-get", R"(echo "$DEBIAN_FRONTEND apt-get $*" >> "$CALLS")");
  }

  void Fake(const std::string& name, const std::string& body) const {
    fs::permissions(Write("bin/" + name, "#!/bin/bash\n" + body + "\n"), fs::perms::owner_all);
  }
  void Remove(const std::string& name) const { fs::remove(Path("bin/" + name)); }

  // Runs it with these packages missing and returns its exit code.
  int Run(const std::string& absent, const std::string& removed = "",
          const std::string& arguments = "") const {
    fs::remove(Path("calls"));
    const std::string command = "env -i PATH='" + Path("bin") + "' CALLS='" + Path("calls") +
                                "' ABSENT='" + absent + "' REMOVED='" + removed + "' /bin/bash '" +
                                LAMINA_SOURCE_DIR "/tools/packages' " + arguments + " > '" +
                                Path("out") + "' 2> '" + Path("err") + "'";
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  std::vector<std::string> LinesOf(const std::string& name) const {
    std::istringstream stream(Bytes(Path(name)));
    std::vector<std::string> lines;
    for (std::string line; std::getline(stream, line);) lines.push_back(line);
    return lines;
  }
};

constexpr char kInstall[] =
    "noninteractive apt-get install -q -y --no-install-recommends libceres-dev gnuplot-nox";

TEST_F(PackagesTest, ListNamesEachPackageOnce) {
  EXPECT_EQ(Run("", "", "--list"), 0);
  const std::vector<std::string> names = LinesOf("out");
  EXPECT_THAT(names, testing::IsSupersetOf({"g++", "libceres-dev", "gnuplot-nox"}));
  EXPECT_THAT(std::set<std::string>(names.begin(), names.end()), SizeIs(names.size()));
  EXPECT_THAT(names, testing::IsSupersetOf({"libgtest-dev", "libopenmpi-dev", "chromium"}));
  EXPECT_EQ(Run("", "", "--install"), 2);
  EXPECT_THAT(Bytes(Path("err")), HasSubstr("usage: tools/packages"));
}

TEST_F(PackagesTest, TheProgramAloneNeedsNoTests) {
  EXPECT_EQ(Run("", "", "--program --list"), 0);
  const std::vector<std::string> names = LinesOf("out");
  EXPECT_THAT(names, testing::IsSupersetOf({"g++", "libceres-dev", "gnuplot-nox"}));
  for (const char* other : {"libgtest-dev", "libopenmpi-dev", "chromium", "pybind11-dev"})
    EXPECT_THAT(names, Not(testing::Contains(other)));
  EXPECT_EQ(Run("libceres-dev gnuplot-nox chromium", "", "--program"), 0);
  EXPECT_THAT(LinesOf("calls"), ElementsAre(" apt-get update -q", kInstall));
}

TEST_F(PackagesTest, NothingMissingIsSilent) {
  EXPECT_EQ(Run(""), 0);
  EXPECT_THAT(LinesOf("calls"), IsEmpty());
  EXPECT_EQ(Bytes(Path("out")) + Bytes(Path("err")), "");
}

TEST_F(PackagesTest, RootInstallsExactlyWhatIsMissing) {
  EXPECT_EQ(Run("libceres-dev", "gnuplot-nox"), 0);
  EXPECT_THAT(LinesOf("calls"), ElementsAre(" apt-get update -q", kInstall));
  EXPECT_THAT(LinesOf("out"), ElementsAre("installing libceres-dev gnuplot-nox"));
}

TEST_F(PackagesTest, OthersInstallBySudo) {
  Fake("id", "echo 1000");
  Fake("sudo", R"(echo sudo >> "$CALLS"; exec "$@")");
  EXPECT_EQ(Run("libceres-dev gnuplot-nox"), 0);
  EXPECT_THAT(LinesOf("calls"), ElementsAre("sudo", " apt-get update -q", "sudo", kInstall));
}

TEST_F(PackagesTest, WithoutRootOrSudoItNamesTheCommand) {
  Fake("id", "echo 1000");
  EXPECT_EQ(Run("libceres-dev gnuplot-nox"), 1);
  EXPECT_THAT(LinesOf("calls"), IsEmpty());
  EXPECT_THAT(Bytes(Path("err")),
              AllOf(HasSubstr("neither root nor sudo"),
                    HasSubstr("apt-get install --no-install-recommends libceres-dev gnuplot-nox")));
}

TEST_F(PackagesTest, WithoutAptGetItNamesThePackages) {
  Remove("apt-get");
  EXPECT_EQ(Run("libceres-dev"), 1);
  EXPECT_THAT(Bytes(Path("err")), AllOf(HasSubstr("no apt-get here"), HasSubstr("libceres-dev"),
                                        Not(HasSubstr("g++"))));
  // Another system: what is installed cannot be known, so all are named.
  Remove("dpkg-query");
  EXPECT_EQ(Run(""), 1);
  EXPECT_THAT(Bytes(Path("err")),
              AllOf(HasSubstr("no apt-get here"), HasSubstr("g++"), HasSubstr("gnuplot-nox")));
}

TEST_F(PackagesTest, AFailedInstallationIsAFailure) {
  Fake("apt-get", R"([[ $1 == update ]] || { echo "E: no such package" >&2; exit 100; })");
  EXPECT_EQ(Run("libceres-dev"), 100);
  EXPECT_THAT(Bytes(Path("err")), HasSubstr("E: no such package"));
}

}  // namespace
}  // namespace lamina
