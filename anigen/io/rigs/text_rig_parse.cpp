#include <cmath>
#include <map>
#include <set>
#include <string_view>

#include "anigen/core/error.h"
#include "anigen/io/meshes/number_text.h"
#include "anigen/io/rigs/text_rig.h"

namespace anigen::io {
namespace {

class Parser {
 public:
  Parser(const std::string& text, const std::string& file) : text_(text), file_(file) {}

  TextRig parse() {
    for_each_line(&Parser::joint_line);  // names first: other lines may stand before the joints they name
    if (rig_.joints.size() == 0) throw InputError(file_, "", "the skeleton has no joint");
    rig_.joints.parents.assign(rig_.joints.size(), -1);
    for_each_line(&Parser::other_line);
    if (!has_root_) throw InputError(file_, "", "there is no root line");
    check(rig_.joints, file_);
    const int above = rig_.joints.parents[static_cast<std::size_t>(rig_.root)];
    if (above >= 0) {
      throw InputError(file_, "",
                       "the root " + rig_.names[static_cast<std::size_t>(rig_.root)] + " has the parent " +
                           rig_.names[static_cast<std::size_t>(above)]);
    }
    return std::move(rig_);
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(file_, "line " + std::to_string(line_), problem);
  }

  void for_each_line(void (Parser::*handle)(std::string_view keyword)) {
    std::string_view rest = text_;
    for (line_ = 1; !rest.empty(); ++line_) {
      const std::size_t end = rest.find('\n');
      left_ = rest.substr(0, end);
      rest = end == std::string_view::npos ? std::string_view() : rest.substr(end + 1);
      const std::string_view keyword = take_token(left_);
      if (!keyword.empty() && keyword.front() != '#') (this->*handle)(keyword);
    }
  }

  void joint_line(std::string_view keyword) {
    if (keyword != "joints") return;
    const std::string name = word("a joint's name");
    Eigen::Vector3d position;
    for (double& x : position) x = number();
    end_of_line();
    if (!index_.try_emplace(name, static_cast<int>(rig_.names.size())).second)
      fail("the joint " + name + " is given twice");
    rig_.names.push_back(name);
    rig_.joints.positions.push_back(position);
  }

  void other_line(std::string_view keyword) {
    if (keyword == "joints") return;
    if (keyword == "root") {
      if (has_root_) fail("there is a second root line");
      rig_.root = joint();
      has_root_ = true;
      end_of_line();
    } else if (keyword == "hier") {
      const int parent = joint(), child = joint();
      end_of_line();
      int& known = rig_.joints.parents[static_cast<std::size_t>(child)];
      if (known >= 0) fail("the joint " + rig_.names[static_cast<std::size_t>(child)] + " already has a parent");
      known = parent;
    } else if (keyword == "skin") {
      skin_line();
    } else {
      fail("\"" + std::string(keyword.substr(0, 40)) + "\" is none of joints, root, hier, skin");
    }
  }

  void skin_line() {
    TextRig::SkinLine skin;
    skin.line = line_;
    const double vertex = number();
    if (vertex < 0 || vertex > 1e12 || vertex != std::floor(vertex)) fail("a vertex number is whole and not negative");
    skin.vertex = static_cast<std::int64_t>(vertex);
    if (!weighted_.insert(skin.vertex).second) fail("vertex " + std::to_string(skin.vertex) + " is weighted twice");
    while (left_.find_first_not_of(" \t\r") != std::string_view::npos) {
      const int target = joint();
      skin.weights.emplace_back(target, static_cast<float>(number()));
    }
    rig_.skin.push_back(std::move(skin));
  }

  std::string word(const char* what) {
    const std::string_view token = take_token(left_);
    if (token.empty()) fail(std::string("the line ends where ") + what + " should be");
    return std::string(token);
  }

  double number() {
    const std::string token = word("a number");
    double value = 0.0;
    if (!parse_number(token, value)) fail("\"" + token.substr(0, 40) + "\" is not a number");
    if (!std::isfinite(value)) fail("\"" + token.substr(0, 40) + "\" is not finite");
    return value;
  }

  int joint() {
    const std::string name = word("a joint's name");
    const auto found = index_.find(name);
    if (found == index_.end()) fail("there is no joint \"" + name.substr(0, 80) + "\"");
    return found->second;
  }

  void end_of_line() {
    const std::string_view token = take_token(left_);
    if (!token.empty()) fail("\"" + std::string(token.substr(0, 40)) + "\" after the end of the line's content");
  }

  const std::string& text_;
  const std::string& file_;
  std::string_view left_;
  std::size_t line_ = 0;
  bool has_root_ = false;
  std::map<std::string, int> index_;
  std::set<std::int64_t> weighted_;
  TextRig rig_;
};

}  // namespace

TextRig parse_text_rig(const std::string& text, const std::string& file) { return Parser(text, file).parse(); }

}  // namespace anigen::io
