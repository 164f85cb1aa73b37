"""Files of laboratories: tables of testing machines, displacement fields of cameras."""
