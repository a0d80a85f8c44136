// Makes a creature and prints the number of its joints.
#include <cstdio>

#include "anigen/creatures/creatures.h"

int main() {
  const anigen::Asset asset = anigen::creatures::make_creature("quadruped", 1, 1);
  std::printf("%zu joints\n", asset.skeleton.size());
  return asset.skeleton.size() > 1 ? 0 : 1;
}
