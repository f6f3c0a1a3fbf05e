"""The brep room: our plain data to kernel objects. Every call into the kernel's modelling is here."""
