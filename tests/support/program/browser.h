// A headless Chromium, driven by chromedriver over its HTTP interface (W3C WebDriver).
//
// It can reach nothing but 127.0.0.1: a page that wanted anything else would not work here.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace lamina {

class Browser {
 public:
  static bool IsInstalled();

  // `folder` takes the browser's own files. A phone has touch and two pixels in one.
  Browser(const std::string& folder, int width, int height, bool phone = false);
  ~Browser();
  Browser(const Browser&) = delete;
  Browser& operator=(const Browser&) = delete;

  void Go(const std::string& url);

  // The value that a script, the body of a function, returns.
  nlohmann::json Run(const std::string& script);

  // Waits until an expression is true in the page; its value, or null when patience is at an end.
  nlohmann::json WaitFor(const std::string& expression);

  // What the page and the browser have complained about since the last call.
  std::vector<std::string> Errors();

  // A PNG, in base64.
  std::string Screenshot();

 private:
  class Driver;
  std::unique_ptr<Driver> driver_;
};

}  // namespace lamina
