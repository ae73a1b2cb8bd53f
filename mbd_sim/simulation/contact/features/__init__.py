"""Which features of two bodies touch: vertices, edges and faces, found outside the compiled steps."""
