from contactlearn.cli import diagnose

if __name__ == "__main__":
    diagnose()
