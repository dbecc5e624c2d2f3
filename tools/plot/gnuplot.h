// Line plots drawn by gnuplot, which must be installed (Debian: gnuplot-nox); it runs as a program
// of its own and gets its script through a pipe.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

namespace lamina {

struct PlotSeries {
  std::string title;
  std::vector<Eigen::Vector2d> points;  // non-finite points break the line
};

// Points drawn below the lines, coloured by z from the lower to the upper of `colour_range`.
struct PlotCloud {
  std::vector<Eigen::Vector3d> points;
  std::string colour_label;
  Eigen::Vector2d colour_range{0.0, 1.0};
};

struct Plot {
  std::string title;
  std::string x_label, y_label;  // with units
  bool equal_axes = false;       // one metre is as long in x as in y
  std::vector<PlotSeries> series;
  PlotCloud cloud = {};  // may be empty
};

// The script that WritePlot pipes to gnuplot; the picture goes to `output_path`.
std::string GnuplotScript(const Plot& plot, const std::string& output_path);

// Draws into a file, whole or not at all; the ending of the path, .svg or .png, says which kind.
// Throws OptionError for another ending, OutputError if gnuplot is missing or fails or the file
// cannot be written.
void WritePlot(const Plot& plot, const std::string& path);

// The same for a script of another kind; `script` gets the path of the picture that it must draw.
void DrawPicture(const std::function<std::string(const std::string&)>& script,
                 const std::string& path);
// "set terminal ..." for a picture of that ending.
std::string GnuplotTerminal(const std::string& path, int width, int height);
// A string in gnuplot's single quotes. Line breaks, which would end the command, become spaces.
std::string GnuplotQuoted(const std::string& text);

}  // namespace lamina
