"""The brep room: our plain data to kernel objects, and what the kernel says of them."""
