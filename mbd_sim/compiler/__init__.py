"""From instruction lists to machine code; nothing here knows mechanics."""
