# For ROS 2 from the Python package index only: its CMake exports name include folders that the wheels
# do not contain, and CMake refuses those when it generates. This hooks the cure into every project().
set(CMAKE_PROJECT_INCLUDE ${CMAKE_CURRENT_LIST_DIR}/wheels_cure.cmake)
