"""What lies between a physical quantity and the number a control unit reads."""
