#pragma once
#include <string>

namespace anigen::eval {

/// What every report of this folder shares: <head> with style, and the scripts for sortable tables, turntables and
/// 3D views, so that a page needs no other file.
std::string page_begin(const std::string& title);
std::string page_end();

}  // namespace anigen::eval
