#include <gtest/gtest.h>
#include "palpate/simulation/world.h"
TEST(X, Y) {}
