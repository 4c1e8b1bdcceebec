"""Plants whose motion was measured are not simulated: which effects their inverse dynamics lack."""
