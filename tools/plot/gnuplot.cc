#include "tools/plot/gnuplot.h"

#include <fmt/format.h>
#include <sys/wait.h>

#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <mutex>

#include "core/base/error.h"
#include "tools/cli/program_path.h"

namespace lamina {
namespace {

// Writing to a gnuplot that has already given up must be an error here, not the end of the program.
class IgnoreBrokenPipes {
 public:
  IgnoreBrokenPipes() : before_(std::signal(SIGPIPE, SIG_IGN)) {}
  ~IgnoreBrokenPipes() { std::signal(SIGPIPE, before_); }
  IgnoreBrokenPipes(const IgnoreBrokenPipes&) = delete;
  IgnoreBrokenPipes& operator=(const IgnoreBrokenPipes&) = delete;

 private:
  void (*before_)(int);
};

void RequireWritable(const std::string& partial, const std::string& path) {
  std::FILE* file = std::fopen(partial.c_str(), "wb");
  if (file == nullptr) {
    throw OutputError("cannot write " + path + ": " + std::strerror(errno));
  }
  std::fclose(file);
}

void RunGnuplot(const std::string& script, const std::string& path) {
  if (!ProgramInPath("gnuplot")) {
    throw OutputError("cannot draw " + path +
                      ": gnuplot is not in PATH (on Debian: apt install gnuplot-nox)");
  }
  // What a broken pipe does is the same for all threads: one gnuplot at a time.
  static std::mutex one_at_a_time;
  const std::lock_guard<std::mutex> lock(one_at_a_time);
  const IgnoreBrokenPipes ignore_broken_pipes;
  std::FILE* gnuplot = popen("gnuplot", "w");
  if (gnuplot == nullptr) {
    throw OutputError("cannot draw " + path + ": gnuplot did not start: " + std::strerror(errno));
  }
  const bool written = std::fwrite(script.data(), 1, script.size(), gnuplot) == script.size();
  const int status = pclose(gnuplot);
  if (!written || status == -1 || !WIFEXITED(status) || WEXITSTATUS(status) != 0) {
    throw OutputError("cannot draw " + path + ": gnuplot failed, see its message above");
  }
}

}  // namespace

// In single quotes only the quote itself is special.
std::string GnuplotQuoted(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text) {
    if (c == '\'') quoted += '\'';
    quoted += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  }
  return quoted + "'";
}

std::string GnuplotTerminal(const std::string& path, int width, int height) {
  const bool png = std::filesystem::path(path).extension() == ".png";
  return fmt::format("set terminal {} size {},{} noenhanced\n",
                     png ? "pngcairo" : "svg background 'white'", width, height);
}

std::string GnuplotScript(const Plot& plot, const std::string& output_path) {
  std::string script = GnuplotTerminal(output_path, 1000, 750);
  script += fmt::format("set output {}\n", GnuplotQuoted(output_path));
  script += fmt::format("set title {}\nset xlabel {}\nset ylabel {}\n", GnuplotQuoted(plot.title),
                        GnuplotQuoted(plot.x_label), GnuplotQuoted(plot.y_label));
  script += "set grid\nset key top left\nset datafile missing 'nan'\n";
  if (plot.equal_axes) script += "set size ratio -1\n";
  for (size_t k = 0; k < plot.series.size(); ++k) {
    script += fmt::format("$series{} << EOD\n", k);
    for (const Eigen::Vector2d& p : plot.series[k].points) {
      script += p.allFinite() ? fmt::format("{:.6g} {:.6g}\n", p.x(), p.y()) : "\n";
    }
    script += "EOD\n";
  }
  if (!plot.cloud.points.empty()) {
    script += "$cloud << EOD\n";
    for (const Eigen::Vector3d& p : plot.cloud.points) {
      script += fmt::format("{:.6g} {:.6g} {:.6g}\n", p.x(), p.y(), p.z());
    }
    script += fmt::format("EOD\nset cblabel {}\nset cbrange [{:.6g}:{:.6g}]\n",
                          GnuplotQuoted(plot.cloud.colour_label), plot.cloud.colour_range.x(),
                          plot.cloud.colour_range.y());
    script += "set palette defined (0 '#1f3b73', 0.35 '#2a9d8f', 0.7 '#e9c46a', 1 '#d62828')\n";
  }
  script += "plot ";
  if (!plot.cloud.points.empty()) {
    script += "$cloud using 1:2:3 with points pointtype 7 pointsize 0.25 palette notitle";
    script += plot.series.empty() ? "" : ", ";
  }
  for (size_t k = 0; k < plot.series.size(); ++k) {
    script += fmt::format("{}$series{} using 1:2 with lines linewidth 2 title {}",
                          k == 0 ? "" : ", ", k, GnuplotQuoted(plot.series[k].title));
  }
  return script + "\nunset output\n";
}

void WritePlot(const Plot& plot, const std::string& path) {
  DrawPicture([&](const std::string& output) { return GnuplotScript(plot, output); }, path);
}

void DrawPicture(const std::function<std::string(const std::string&)>& script,
                 const std::string& path) {
  const std::string ending = std::filesystem::path(path).extension().string();
  if (ending != ".svg" && ending != ".png") {
    throw OptionError("cannot draw " + path + ": the name must end in .svg or .png");
  }
  const std::string partial = path + ".partial" + ending;
  // gnuplot would tell only its own screen, and draw there.
  RequireWritable(partial, path);
  try {
    RunGnuplot(script(partial), path);
    std::error_code gone;
    if (std::filesystem::file_size(partial, gone) == 0 || gone) {
      throw OutputError("cannot draw " + path + ": gnuplot drew nothing, see its message above");
    }
  } catch (...) {
    std::remove(partial.c_str());
    throw;
  }
  std::error_code error;
  std::filesystem::rename(partial, path, error);
  if (error) throw OutputError("cannot write " + path + ": " + error.message());
}

}  // namespace lamina
